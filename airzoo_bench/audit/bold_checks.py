"""Bold numbers against the best of their columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.core.plurals import counted
from airzoo_bench.tables.printed.cells import PrintedValue, Published, grouped

__all__ = ["check_bold"]

_MOST_NAMES = 10


def check_bold(published: Published) -> Outcome:
    """Find bold values that are not the best of their column, and best ones that are not bold.

    Only in columns that print something bold, since averages alone may be marked, and for scores
    whose better direction is known. Of several that share the best printed value, one is to be bold
    at least: which is best before rounding, the table does not say.
    """
    what = "columns, whether the best is bold and nothing else"
    if not published.has_bold:
        return Outcome("bold", 0, what, "the file does not say what is bold")
    columns = published.by(lambda c: (c.table, *c.group, c.scene, c.measure)).values()
    races = [
        race
        for column in columns
        if _is_race(race := [cell for cell in column if cell.competes or cell.bold])
    ]
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
    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    for table, own in grouped(judged, lambda column: column[0].table).items():
        found, by_section = _judge_table(own)
        findings += found
        if by_section:
            text = "the best of each part of the table, between rules or titles, is bold"
            conclusions.append(Conclusion("bold", table, text))
    cells = tuple(cell for column in judged for cell in column)
    said, not_judged = tuple(conclusions), " and ".join(left)
    return Outcome("bold", len(judged), what, not_judged, tuple(findings), said, cells)


def _has_bold(column: Sequence[PrintedValue]) -> bool:
    return any(cell.bold for cell in column)


def _judge_table(columns: Sequence[Sequence[PrintedValue]]) -> tuple[list[Finding], bool]:
    """Judge whole columns, or the parts of these, by what explains more of a table's bold."""
    whole = [finding for column in columns for finding in _judge_column(column)]
    parts = [
        part
        for column in columns
        for part in grouped(column, lambda cell: cell.section).values()
        if _has_bold(part)
    ]
    apart = [finding for part in parts for finding in _judge_column(part)]
    # A part that has nothing bold says nothing; several that have, each of their own, do.
    by_section = len(parts) > len(columns) and len(apart) < len(whole)
    return (apart, True) if by_section else (whole, False)


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
