"""Published tables from a file: every printed number with where it stands."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from airzoo_bench.core.errors import ResultError, first_of
from airzoo_bench.tables.printed.annotations import is_no_number
from airzoo_bench.tables.printed.benchmarks import with_benchmarks
from airzoo_bench.tables.printed.cells import PrintedValue, Published
from airzoo_bench.tables.printed.column_titles import is_summary_name
from airzoo_bench.tables.printed.fields import fields_of
from airzoo_bench.tables.printed.grid import Grid
from airzoo_bench.tables.printed.rows import told_apart, without_differences
from airzoo_bench.tables.printed.scores import Family, Score, is_of_no_rank, recall_of_cloud
from airzoo_bench.tables.printed.sources import Source, read_sources
from airzoo_bench.tables.printed.values import read_cell, readable

__all__ = ["read_published", "resolve_ambiguous"]

_PERCENT = {"%", "percent"}
_MOST_NUMBERS = 20_000
_AMBIGUOUS = "all shares are at most 1: percent, or from 0 to 1?"


def resolve_ambiguous(cells: Sequence[PrintedValue], *, marked: bool) -> tuple[PrintedValue, ...]:
    """Say of cells what is not bold, which recalls are of clouds, and what accuracy is.

    Parameters
    ----------
    cells : sequence of PrintedValue
        All of a file.
    marked : bool
        Whether the file says what is bold.
    """
    families = {cell.score.family for cell in cells}
    both = {Family.ACCURACY, Family.COMPLETENESS} <= families
    # Next to F1, accuracy and completeness without a unit may be precision and recall.
    distances = both and Family.F1 not in families
    of_clouds = _cloud_distances(cells)
    return tuple(
        _settled(_of_cloud(c, of_clouds), marked=marked, distances=distances) for c in cells
    )


def _cloud_distances(cells: Iterable[PrintedValue]) -> dict[tuple[object, ...], None]:
    """Return where F1 at a distance, or precision at one in metres, is printed, and which."""
    return dict.fromkeys(
        (cell.table, *cell.group, cell.score.thresholds)
        for cell in cells
        if cell.score.family in (Family.F1, Family.PRECISION) and cell.score.thresholds
    )


def _of_cloud(cell: PrintedValue, distances: Container[tuple[object, ...]]) -> PrintedValue:
    """Take R@10m, and P@10, for recall and precision of clouds where F1@10 stands next to them."""
    score = cell.score
    thresholds = score.thresholds
    if score.family is Family.AVERAGE_PRECISION and score.variant == "precision":
        thresholds = ((Fraction(score.cutoff), ""),)
    elif score.family is not Family.HITS:
        return cell
    if (cell.table, *cell.group, thresholds) not in distances:
        return cell
    return replace(cell, score=recall_of_cloud(score))


def _settled(cell: PrintedValue, *, marked: bool, distances: bool) -> PrintedValue:
    """Say of a cell what only the whole file tells: what is not bold, and what accuracy is."""
    score = cell.score
    if score.family in (Family.ACCURACY, Family.COMPLETENESS):
        # Accuracy of a cloud is a distance; a lone one, or one in percent, is anybody's.
        percent = cell.unit.casefold() in _PERCENT
        if percent or not (distances or cell.unit):
            better = True if percent else None
            score = replace(score, family=Family.OTHER, higher_is_better=better)
    if is_of_no_rank(score):
        score = Score(score.name, Family.OTHER)
    if distances and score.family is Family.OTHER and is_summary_name(score.name):
        score = replace(score, family=Family.CHAMFER, higher_is_better=False)
    bold = (cell.bold or False) if marked else None
    return replace(cell, score=score, bold=bold)


@dataclass(frozen=True)
class _Table:
    """One table, read: its numbers, and what is to be said of how it was read."""

    cells: tuple[PrintedValue, ...]
    unused: tuple[str, ...]
    has_bold: bool
    is_markup: bool
    infinite: int
    notes: tuple[str, ...]


def read_published(path: Path) -> Published:
    """Read published tables.

    Parameters
    ----------
    path : Path
        CSV (comma, semicolon or tab), Markdown, or LaTeX, of rows or of a whole paper. A table is
        either long, a line a number: the columns method, scene, metric and value, and any of table,
        benchmark, track, unit, n, bold, gain (or printed_delta). Or wide, a line a method: the
        column method, and any of scene, table, benchmark, track and n; the other columns are
        scores. A value may be marked as bold and have a gain next to it; one that is empty or a
        dash is left out. Of a file with several tables each is read by itself, and one that holds
        no scores, or cannot be read, is left out with a note.

    Raises
    ------
    ResultError
        A column is missing or mistyped, a value is no printed number, a cell stands there twice,
        or it cannot be told whether shares are in percent; of several tables, none can be read.
    """
    sources, notes = read_sources(path)
    if len(sources) == 1:
        return _published(path, [_read(path, sources[0].read(), strict=True)], notes)
    read = [_read_or_skip(path, source) for source in sources]
    tables = [table for table in read if isinstance(table, _Table)]
    left = [table for table in read if isinstance(table, str)]
    if not tables:
        raise ResultError(
            f"none of {len(left)} tables can be read: {left[0][:300]}",
            where=path,
            expected="a table of scores, with a column of methods",
        )
    return _published(path, tables, [*notes, *left])


def _read_or_skip(path: Path, source: Source) -> _Table | str:
    """Read one table of several, or say why it is left out."""
    try:
        return _read(path, source.read(), strict=False)
    except ResultError as error:
        place = f"{source.label}, line {source.line}"
        named = source.label if source.label.endswith(f"line {source.line}") else place
        where = (error.where or "").removeprefix(str(path)).removeprefix(", ")
        return f"left out: {named}: " + (f"{where}: " if where else "") + error.what


def _published(path: Path, tables: Sequence[_Table], notes: Sequence[str]) -> Published:
    said = dict.fromkeys(note for table in tables for note in table.notes)
    infinite = sum(table.infinite for table in tables)
    if infinite:
        said[f"infinite values, left out: {infinite}"] = None
    cells = [cell for table in tables for cell in table.cells]
    if len(cells) > _MOST_NUMBERS:
        raise _too_many(path)
    marked = any(table.has_bold for table in tables)
    kept, linked = with_benchmarks(cells, is_markup=tables[0].is_markup)
    unused = dict.fromkeys(name for table in tables for name in table.unused)
    return Published(path.name, kept, tuple(unused), marked, (*notes, *said, *linked))


def _too_many(path: Path) -> ResultError:
    return ResultError(
        f"more than {_MOST_NUMBERS:,} numbers", where=path, fix="audit a table at a time"
    )


def _read(path: Path, grids: Sequence[Grid], *, strict: bool) -> _Table:
    if sum(len(grid.rows) * len(grid.columns) for grid in grids) > 8 * _MOST_NUMBERS:
        raise _too_many(path)
    layouts = [fields_of(path, grid) for grid in grids]
    fields = [field for layout in layouts for field in layout.fields]
    notes = [note for layout in layouts for note in layout.notes]
    is_markup = any(grid.is_markup for grid in grids)
    if is_markup:
        fields, dropped = without_differences(fields)
        if dropped:
            notes.append(f"differences between rows, left out: line {_listed(dropped)}")
        fields, note = told_apart(fields)
        notes += [note] if note else []
    if len(fields) > _MOST_NUMBERS:
        raise _too_many(path)
    fields, said = (fields, []) if strict else readable(fields)
    cells = [cell for field in fields if (cell := read_cell(field, strict=strict)) is not None]
    marked = any(layout.has_bold for layout in layouts) or any(cell.bold for cell in cells)
    kept = resolve_ambiguous(cells, marked=marked)
    if not kept and said:
        raise ResultError(f"no printed number; {said[0]}", where=path)
    _check_cells(path, kept)
    if _may_be_shares(kept):
        if strict:
            raise _ambiguous(path, kept)
        kept = tuple(
            replace(cell, unit="share", full=1) if cell.score.is_share and not cell.unit else cell
            for cell in kept
        )
        said.append("shares that are all at most 1 are read as such, not in percent")
    label = next((cell.table for cell in kept if cell.table), "")
    unused = tuple(name for layout in layouts for name in layout.unused)
    odd = [field["value"].casefold() for field in fields if is_no_number(field["value"])]
    infinite = sum("inf" in text or "∞" in text for text in odd)
    named = [f"{label}: {note}" if label and not strict else note for note in (*notes, *said)]
    return _Table(kept, unused, marked, is_markup, infinite, tuple(named))


def _listed(lines: Sequence[int]) -> str:
    return ", ".join(map(str, lines[:10])) + (" ..." if len(lines) > 10 else "")


def _check_cells(path: Path, cells: tuple[PrintedValue, ...]) -> None:
    if not cells:
        raise ResultError("no printed number", where=path, expected="a line a number or a method")
    first: dict[tuple[str, ...], int] = {}
    for cell in cells:
        # Average and average are one.
        scene, score = cell.scene.casefold(), cell.score.name.casefold()
        names = (cell.table, cell.benchmark, cell.track, scene, cell.method, score)
        if names in first:
            raise ResultError(
                f"{cell.score.name} of {cell.method} on {cell.place} again",
                where=f"{path}, line {cell.line}",
                expected=f"once in a table; line {first[names]} has it",
                fix="tell tables apart by a column 'table'",
            )
        first[names] = cell.line


def _may_be_shares(cells: Sequence[PrintedValue]) -> bool:
    shares = [cell for cell in cells if cell.score.is_share and not cell.unit]
    # Nothing at all is 0 by either.
    printed = [cell.number.value for cell in shares if cell.number.value]
    return bool(printed) and all(0 < value <= 1 for value in printed)


def _ambiguous(path: Path, cells: Sequence[PrintedValue]) -> ResultError:
    names = dict.fromkeys(c.score.name for c in cells if c.score.is_share and not c.unit)
    return ResultError(
        f"{_AMBIGUOUS} {first_of(names)}",
        where=path,
        expected="a column 'unit' that says % or share, or R@1 [%] or R@1 [share] as its name",
    )
