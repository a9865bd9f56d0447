"""Published tables from a file: every printed number with where it stands."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

from airzoo_bench.errors import ResultError, first_of
from airzoo_bench.printed.fields import Field, fields_of
from airzoo_bench.printed.grid import read_grid
from airzoo_bench.printed.marks import Marked, read_marked
from airzoo_bench.printed.numbers import Interval, Rounded
from airzoo_bench.printed.scores import Family, Score, read_score

__all__ = ["Printed", "Published", "grouped", "read_published"]

T = TypeVar("T")

_SUMMARIES = {"overall", "average", "avg", "avg.", "mean", "all", "total"}
_PERCENT = {"%", "percent"}
_FULL = {"share": 1, "1": 1} | dict.fromkeys(_PERCENT, 100)
_BOLD = {"1": True, "true": True, "yes": True, "0": False, "false": False, "no": False, "": False}
_ABSENT = {"", "-", "–", "—", "--", "---", "n/a", "na"}
_MOST_QUERIES = 1_000_000_000


@dataclass(frozen=True)
class Printed:
    """A printed number and where it stands.

    Attributes
    ----------
    line : int
        Of the file.
    full : int
        What a share of all is printed as: 100 or 1.
    gain : Rounded or None
        The difference that is printed beside it.
    bold : bool or None
        None where the file does not say.
    queries : int or None
        Of its scene, where the file says so.
    """

    line: int
    table: str
    benchmark: str
    track: str
    scene: str
    method: str
    score: Score
    unit: str
    full: int
    number: Rounded
    gain: Rounded | None
    bold: bool | None
    queries: int | None

    @property
    def is_summary(self) -> bool:
        """Whether it stands for several scenes."""
        return self.scene.casefold() in _SUMMARIES

    @property
    def group(self) -> tuple[str, str]:
        """Benchmark and track: what scenes and their averages have in common."""
        return self.benchmark, self.track

    @property
    def place(self) -> str:
        """Benchmark and scene, for people."""
        return ", ".join(part for part in (self.benchmark, self.scene) if part)

    @property
    def share(self) -> Interval:
        """The interval of the true number, as a share from 0 to 1."""
        return self.number.interval.times(Fraction(1, self.full))


@dataclass(frozen=True)
class Published:
    """The numbers of one file, in its order.

    Attributes
    ----------
    source : str
        The file's name.
    cells : tuple of Printed
    unused_columns : tuple of str
    has_bold : bool
        Whether the file says what is bold.
    """

    source: str
    cells: tuple[Printed, ...]
    unused_columns: tuple[str, ...]
    has_bold: bool

    def by(self, key: Callable[[Printed], T]) -> dict[T, list[Printed]]:
        """Group the cells, in the order of the file."""
        return grouped(self.cells, key)


def grouped(cells: Iterable[Printed], key: Callable[[Printed], T]) -> dict[T, list[Printed]]:
    """Group cells, in their order."""
    groups: dict[T, list[Printed]] = {}
    for cell in cells:
        groups.setdefault(key(cell), []).append(cell)
    return groups


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
    layout = fields_of(path, read_grid(path))
    cells = [cell for field in layout.fields if (cell := _read_cell(field)) is not None]
    marked = layout.has_bold or any(cell.bold for cell in cells)
    both = {Family.ACCURACY, Family.COMPLETENESS} <= {cell.score.family for cell in cells}
    kept = tuple(_settled(cell, marked=marked, distances=both) for cell in cells)
    _check_cells(path, kept)
    return Published(path.name, kept, layout.unused, marked)


def _read_cell(field: Field) -> Printed | None:
    for name in ("method", "metric"):
        if not field[name]:
            raise ResultError(f"no {name}", where=field.where(name), expected="a name")
    if field["value"].casefold() in _ABSENT:
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
    if field["gain"].casefold() in _ABSENT:
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
    if not text:
        return None
    if not (text.isascii() and text.isdigit() and 0 < int(text[:12]) <= _MOST_QUERIES):
        raise ResultError(
            f"n is {text[:80]!r}",
            where=field.where("n"),
            expected="the number of queries of the scene",
        )
    return int(text)


def _settled(cell: Printed, *, marked: bool, distances: bool) -> Printed:
    """Say of a cell what only the whole file tells: what is not bold, and what accuracy is."""
    score = cell.score
    if score.family in (Family.ACCURACY, Family.COMPLETENESS):
        # Accuracy of a cloud is a distance; a lone one, or one in percent, is anybody's.
        percent = cell.unit.casefold() in _PERCENT
        if percent or not (distances or cell.unit):
            better = True if percent else None
            score = replace(score, family=Family.OTHER, higher_is_better=better)
    bold = (cell.bold or False) if marked else None
    return replace(cell, score=score, bold=bold)


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
    if shares and all(0 <= cell.number.value <= 1 for cell in shares):
        raise ResultError(
            "all shares are at most 1: percent, or from 0 to 1? "
            + first_of(dict.fromkeys(cell.score.name for cell in shares)),
            where=path,
            expected="a column 'unit' that says % or share, or R@1 [%] or R@1 [share] as its name",
        )
