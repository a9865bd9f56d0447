"""What only the whole file tells of a number: beside what it stands."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from fractions import Fraction

from airzoo_bench.tables.printed.cells import PrintedValue
from airzoo_bench.tables.printed.column_titles import is_summary_name
from airzoo_bench.tables.printed.scores import Family, recall_of_cloud

__all__ = ["resolve_ambiguous"]

_PERCENT = {"%", "percent"}


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
    # Beside F1, accuracy and completeness without a unit may be precision and recall.
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
    """Take R@10m, and P@10, for recall and precision of clouds where F1@10 stands beside them."""
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
    if distances and score.family is Family.OTHER and is_summary_name(score.name):
        score = replace(score, family=Family.CHAMFER, higher_is_better=False)
    bold = (cell.bold or False) if marked else None
    return replace(cell, score=score, bold=bold)
