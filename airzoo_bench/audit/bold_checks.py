"""Bold numbers against the best of their columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from airzoo_bench.audit.findings import Finding, Grade, Outcome
from airzoo_bench.core.errors import counted
from airzoo_bench.tables.printed_values import PrintedValue, Published

__all__ = ["check_bold"]

_MOST_NAMES = 10


def check_bold(published: Published) -> Outcome:
    """Find bold values that are not the best of their column, and best ones that are not bold."""
    what = "columns, whether the best is bold and nothing else"
    if not published.has_bold:
        return Outcome("bold", 0, what, "the file does not say what is bold")
    columns = published.by(lambda c: (c.table, *c.group, c.scene, c.score.name)).values()
    races = [column for column in columns if _is_race(column)]
    judged = [column for column in races if _has_bold(column)]
    plain = [column for column in races if not _has_bold(column)]
    left = []
    if plain:
        places = list(dict.fromkeys(f"{c[0].score.name} of {c[0].place}" for c in plain))
        shown = ", ".join(places[:3]) + (" ..." if len(places) > 3 else "")
        left.append(f"{counted(len(plain), 'column')} in which nothing is bold ({shown})")
    if len(races) < len(columns):
        left.append(
            f"{counted(len(columns) - len(races), 'column')} of one method or an unknown score"
        )
    findings = tuple(finding for column in judged for finding in _judge_column(column))
    cells = tuple(cell for column in judged for cell in column)
    return Outcome("bold", len(judged), what, " and ".join(left), findings, cells=cells)


def _has_bold(column: Sequence[PrintedValue]) -> bool:
    return any(cell.bold for cell in column)


def _is_race(column: Sequence[PrintedValue]) -> bool:
    return bool(column) and column[0].score.higher_is_better is not None and len(column) > 1


def _judge_column(column: Sequence[PrintedValue]) -> list[Finding]:
    pick = max if column[0].score.higher_is_better else min
    best = pick(column, key=lambda cell: cell.number.value).number
    leaders = [cell for cell in column if cell.number.value == best.value]
    bold_leaders = _names(cell for cell in leaders if cell.bold)
    all_leaders, all_bold = _names(leaders), _names(cell for cell in column if cell.bold)
    better = "higher" if column[0].score.higher_is_better else "lower"
    findings = []
    for cell in column:
        text, leads = cell.number.text, cell.number.value == best.value
        if bool(cell.bold) == leads:
            continue
        grade = Grade.ROUNDING if leads and bold_leaders else Grade.INCONSISTENT
        if not leads:
            why = f"{text} is bold, but {all_leaders} has {best.text}, and {better} is better"
        elif bold_leaders:
            why = f"{text} is not bold, but the same number of {bold_leaders} is"
        else:
            why = f"{text} is the best of {len(column)} methods, but {all_bold} is bold"
        findings.append(Finding(grade, "bold", cell, why))
    return findings


def _names(cells: Iterable[PrintedValue]) -> str:
    """Name methods, the first few where all of a long table are alike."""
    names = [cell.method for cell in cells]
    more = [f"{len(names) - _MOST_NAMES} more"] if len(names) > _MOST_NAMES else []
    return " and ".join([*names[:_MOST_NAMES], *more])
