"""How scores and ranks move with the values that a truth assumes, as a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from airzoo_bench.core.plurals import counted
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.sensitivity import TOGETHER, Sensitivity
from airzoo_bench.tables.method_table import as_shown
from airzoo_bench.tables.model import Cell, Column, Row, Table, show_number
from airzoo_bench.tables.wording import noise_floor_note, score_title

__all__ = ["sensitivity_table"]

_TITLES = {
    "field_of_view": "Field of view",
    "heading_deg": "Heading",
    "height_m": "Height",
    "position_m": "Position",
    TOGETHER: "Together",
}


def sensitivity_table(
    found: Sensitivity,
    ranges: Mapping[str, float],
    scores: Sequence[ScoreColumn],
    without: Sequence[str] = (),
) -> Table:
    """Lay out a row a score and method: its value, ranges, and ranks if several.

    Parameters
    ----------
    found : Sensitivity
    ranges : mapping of str to float
        Those that are not 0, see `AssumedRanges`.
    scores : sequence of ScoreColumn
        Those to show.
    without : sequence of str
        Assumptions of the truth that no range covers.
    """
    groups, several = list(dict.fromkeys(found.groups)), len(found.methods) > 1
    columns = (
        *map(Column, ("Score", "Method", "Value")),
        *(Column(_TITLES[group], group="Between, if assumed values are off") for group in groups),
        *(Column(title, group="Rank") for title in ("Here", "Best", "Worst") if several),
    )
    ranks = found.ranks() if several else ()
    rows = tuple(
        _row(found, groups, ranks, method, score)
        for score, column in enumerate(found.scores)
        if column in scores
        for method in range(len(found.methods))
    )
    count = len(found.groups)
    return Table(
        "What assumed values are worth, average over scenes",
        columns,
        rows,
        (
            f"off by: {'; '.join(_range(name, value) for name, value in ranges.items())}; "
            f"{counted(count, 'variant')} of the truth",
            *([f"not covered: {'; '.join(without)}"] if without else []),
            *_unanswerable(found),
            *_floors(found, scores),
        ),
        leading=2,
        groups_per_block=len(columns),
        fixed=True,
    )


def _row(
    found: Sensitivity,
    groups: list[str],
    ranks: tuple[Floats, ...],
    method: int,
    score: int,
) -> Row:
    column, values = found.scores[score], found.overall[:, method, score]
    spans = []
    for group in groups:
        ends = values[[one == group for one in found.groups]]
        low, high = (show_number(as_shown(column, end), 2) for end in (ends.min(), ends.max()))
        spans.append(Cell(f"{low} to {high}"))
    return Row(
        (
            Cell(score_title(column)),
            Cell(found.methods[method]),
            Cell(as_shown(column, float(found.overall_base[method, score]))),
            *spans,
            *(Cell(int(rank[method, score])) for rank in ranks),
        )
    )


def _range(name: str, value: float) -> str:
    if name == "position_m":
        return f"position of each photo {value:g} m (standard deviation)"
    if name == "field_of_view":
        return f"field of view {100 * value:g} % either way"
    unit = "degrees" if name == "heading_deg" else "m"
    return f"{_TITLES[name].lower()} {value:g} {unit} either way"


def _unanswerable(found: Sensitivity) -> list[str]:
    most = int(found.unanswerable.sum(axis=1).max())
    if not most:
        return []
    return [
        f"up to {counted(most, 'query')} had no tile left in a variant, and were left out of it"
    ]


def _floors(found: Sensitivity, scores: Sequence[ScoreColumn]) -> list[str]:
    if len(found.methods) < 2:
        return ["no noise floor: it is of differences, which need two results"]
    floors = dict(zip(found.scores, found.floors().tolist(), strict=True))
    return noise_floor_note({score: floors[score] for score in scores})
