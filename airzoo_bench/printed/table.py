"""Published tables from a file: every printed number with where it stands."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.errors import ResultError, first_of
from airzoo_bench.printed.cells import Printed, Published
from airzoo_bench.printed.company import settled
from airzoo_bench.printed.fields import Field, fields_of
from airzoo_bench.printed.grid import read_grids
from airzoo_bench.printed.marks import Marked, is_no_number, read_marked
from airzoo_bench.printed.numbers import Rounded
from airzoo_bench.printed.scores import Score, read_score

__all__ = ["read_published"]

_PERCENT = {"%", "percent"}
_FULL = {"share": 1, "1": 1} | dict.fromkeys(_PERCENT, 100)
_BOLD = {"1": True, "true": True, "yes": True, "0": False, "false": False, "no": False, "": False}
_MOST_QUERIES = 1_000_000_000


def read_published(path: Path) -> Published:
    """Read published tables.

    Parameters
    ----------
    path : Path
        CSV (comma, semicolon or tab), a Markdown table, or the rows of a LaTeX table. Either long,
        a line a number: the columns method, scene, metric and value, and any of table, benchmark,
        track, unit, n, bold, gain (or printed_delta). Or wide, a line a method: the column method,
        and any of scene, table, benchmark, track and n; the other columns are scores. A value may
        be marked as bold and have a gain beside it; one that is empty or a dash is left out.

    Raises
    ------
    ResultError
        A column is missing or mistyped, a value is no printed number, a cell stands there twice,
        or it cannot be told whether shares are in percent.
    """
    layouts = [fields_of(path, grid) for grid in read_grids(path)]
    fields = [field for layout in layouts for field in layout.fields]
    cells = [cell for field in fields if (cell := _read_cell(field)) is not None]
    marked = any(layout.has_bold for layout in layouts) or any(cell.bold for cell in cells)
    kept = settled(cells, marked=marked)
    _check_cells(path, kept)
    unused = dict.fromkeys(name for layout in layouts for name in layout.unused)
    notes = dict.fromkeys(note for layout in layouts for note in layout.notes)
    infinite = sum(_is_infinite(field["value"]) for field in fields)
    if infinite:
        notes[f"infinite values, left out: {infinite}"] = None
    return Published(path.name, kept, tuple(unused), marked, tuple(notes))


def _is_infinite(text: str) -> bool:
    return is_no_number(text) and any(sign in text.casefold() for sign in ("inf", "∞"))


def _read_cell(field: Field) -> Printed | None:
    for name in ("method", "metric"):
        if not field[name]:
            raise ResultError(f"no {name}", where=field.where(name), expected="a name")
    if is_no_number(field["value"]):
        return None
    marked = _marked(field)
    score = read_score(field["metric"])
    unit = field["unit"] or ("%" if marked.percent else "")
    return Printed(
        line=field.line,
        table=field["table"],
        benchmark=field["benchmark"],
        track=field["track"],
        scene=field["scene"],
        method=field["method"],
        score=score,
        unit=unit,
        full=_full(field, score, unit),
        number=marked.number,
        gain=_gain(field, marked),
        bold=_bold(field, marked),
        queries=_queries(field),
        may_average=field.may_average,
    )


def _marked(field: Field, name: str = "value") -> Marked:
    marked = read_marked(field[name])
    if isinstance(marked, str):
        raise ResultError(
            marked,
            where=field.where(name),
            expected="a number as printed, such as 96.21, 96.21%, **96.21** or 96.21 (+1.73)",
            mend="leave deviations and footnotes out; a dash stands for no number",
        )
    return marked


def _gain(field: Field, marked: Marked) -> Rounded | None:
    if is_no_number(field["gain"]):
        return marked.gain
    beside = _marked(field, "gain").number
    if marked.gain and marked.gain.value != beside.value:
        raise ResultError(
            f"gain {beside.text} here and {marked.gain.text} beside the value",
            where=field.where("gain"),
            mend="keep one",
        )
    return beside


def _full(field: Field, score: Score, unit: str) -> int:
    if not score.is_share:
        return 1
    if unit and unit.casefold() not in _FULL:
        raise ResultError(
            f"unit {unit[:80]!r} for {score.name[:80]!r}, a {score.family.value}",
            where=field.where("unit"),
            expected="% or share",
        )
    return _FULL[unit.casefold() or "%"]


def _bold(field: Field, marked: Marked) -> bool | None:
    if "bold" not in field.texts:
        return marked.bold or None
    text = field["bold"].casefold()
    if text not in _BOLD:
        raise ResultError(
            f"bold is {field['bold'][:80]!r}", where=field.where("bold"), expected="1 or 0"
        )
    return marked.bold or _BOLD[text]


def _queries(field: Field) -> int | None:
    text = field["n"]
    if is_no_number(text):
        return None
    if not (text.isascii() and text.isdigit() and 0 < int(text[:12]) <= _MOST_QUERIES):
        raise ResultError(
            f"n is {text[:80]!r}",
            where=field.where("n"),
            expected="the number of queries of the scene",
        )
    return int(text)


def _check_cells(path: Path, cells: tuple[Printed, ...]) -> None:
    if not cells:
        raise ResultError("no printed number", where=path, expected="a line a number or a method")
    first: dict[tuple[str, ...], int] = {}
    for cell in cells:
        names = (cell.table, cell.benchmark, cell.track, cell.scene, cell.method, cell.score.name)
        if names in first:
            raise ResultError(
                f"{cell.score.name} of {cell.method} on {cell.place} again",
                where=f"{path}, line {cell.line}",
                expected=f"once in a table; line {first[names]} has it",
                mend="tell tables apart by a column 'table'",
            )
        first[names] = cell.line
    shares = [cell for cell in cells if cell.score.is_share and not cell.unit]
    # Nothing at all is 0 by either.
    printed = [cell.number.value for cell in shares if cell.number.value]
    if printed and all(0 < value <= 1 for value in printed):
        raise ResultError(
            "all shares are at most 1: percent, or from 0 to 1? "
            + first_of(dict.fromkeys(cell.score.name for cell in shares)),
            where=path,
            expected="a column 'unit' that says % or share, or R@1 [%] or R@1 [share] as its name",
        )
