"""What stands in tables of methods: numbers as they are shown, whether scored here or reported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from airzoo_bench.results.comparable import check_comparable, version_notes
from airzoo_bench.results.files import method_names
from airzoo_bench.results.floors import FLOOR_MARK, floor_note, notes_of
from airzoo_bench.results.result import Reference, Result, ScoreColumn
from airzoo_bench.tables.model import Cell, Column, Uncertainty, share_to_percent

if TYPE_CHECKING:
    from pathlib import Path

__all__ = [
    "OVERALL",
    "UNITS",
    "MethodRow",
    "MethodTable",
    "as_shown",
    "identity",
    "method_table",
    "score_column",
    "shown_values",
]

OVERALL = ""
"""The key of the average over scenes, which no scene has."""

UNITS = {"share": "%", "m": "m", "deg": "deg"}
"""What tables show for the unit of a score."""


@dataclass(frozen=True)
class MethodRow:
    """A method's numbers: percent, metres, degrees.

    Attributes
    ----------
    values : mapping of str to mapping of str to float
        By scene, with `OVERALL` for the average, then by score.
    uncertainties : mapping of str to mapping of str to Between or PlusMinus
        In the same order, where there are any.
    reported : str
        Where the numbers were printed; empty for those that were scored here.
    floor : bool
        Whether it is no method, but what scores without one.
    mark : str
        Stands behind the method's name; a note says what it means.
    """

    method: str
    values: Mapping[str, Mapping[str, float]]
    uncertainties: Mapping[str, Mapping[str, Uncertainty]] = field(default_factory=dict)
    reported: str = ""
    floor: bool = False
    mark: str = ""

    def cell(self, scene: str, score: ScoreColumn) -> Cell:
        """Return the cell of one score in one scene; without a number where there is none."""
        return Cell(
            self.values.get(scene, {}).get(score.key),
            uncertainty=self.uncertainties.get(scene, {}).get(score.key),
        )


@dataclass(frozen=True)
class MethodTable:
    """Entries that may stand in one table: of one protocol and truth, or reported for them.

    Attributes
    ----------
    scenes : mapping of str to str
        Titles by id.
    queries : mapping of str to int
        How many each scene has, where that is known.
    method_notes : tuple of str
        Of the results themselves; each says whose it is.
    notes : tuple of str
        Of all together.
    legend : tuple of str
        Those of the notes without which reported numbers mislead.
    about_intervals : tuple of str
        Those that say how intervals were made, and where there is none; of the legend too.
    identity : str
        What the numbers depend on; see `identity`.
    """

    title: str
    benchmark: str
    track: str
    scores: tuple[ScoreColumn, ...]
    scenes: Mapping[str, str]
    queries: Mapping[str, int]
    rows: tuple[MethodRow, ...]
    method_notes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    legend: tuple[str, ...] = ()
    about_intervals: tuple[str, ...] = ()
    identity: str = ""

    @property
    def all_notes(self) -> tuple[str, ...]:
        """The notes of all and of methods, and last what the numbers depend on."""
        return (*self.notes, *self.method_notes, *filter(None, [self.identity]))

    @property
    def whole_legend(self) -> tuple[str, ...]:
        """The notes that LaTeX prints under the table."""
        return (*self.legend, *self.about_intervals)

    def noted(self, *notes: str, legend: bool = False) -> MethodTable:
        """Return the table with further notes, which may be of the legend."""
        more = notes if legend else ()
        return replace(self, notes=(*self.notes, *notes), legend=(*self.legend, *more))


def method_table(
    results: Sequence[Result], *, paths: Sequence[Path] = (), every_score: bool = False
) -> MethodTable:
    """Put results of one protocol and one truth into one table of methods."""
    methods = [result.predictions.method for result in results]
    names = method_names(paths, results) if paths else methods
    # Who reads a refusal looks for files.
    called = [f"{m} ({p})" for m, p in zip(methods, paths, strict=True)] if paths else methods
    check_comparable(called, results)
    first = results[0]
    # One that a method has no score for stays empty.
    scores = {c.key: c for r in results for c in r.columns if every_score or c.headline}
    floors = [floor_note(result) for result in results]
    by_note = _by_note(names, results)
    return MethodTable(
        f"{first.protocol.name} v{first.protocol.version}",
        first.truth.benchmark,
        first.track,
        tuple(scores.values()),
        first.truth.scene_titles,
        {scene: counts["queries"] for scene, counts in first.counts.items()},
        tuple(
            MethodRow(name, shown_values(result.columns, result), mark=FLOOR_MARK * bool(floor))
            for name, result, floor in zip(names, results, floors, strict=True)
        ),
        method_notes=tuple(f"{who}: {note}" for note, who in by_note.items()),
        legend=tuple(f"{by_note[floor]}: {floor}" for floor in dict.fromkeys(floors) if floor),
        notes=tuple(version_notes(names, results)),
        identity=identity(first),
    )


def _by_note(names: Sequence[str], results: Sequence[Result]) -> dict[str, str]:
    """Return the names of all that note the same, by what they note."""
    methods: dict[str, list[str]] = {}
    for name, result in zip(names, results, strict=True):
        for note in dict.fromkeys(notes_of(result)):
            methods.setdefault(note, []).append(name)
    return {note: ", ".join(who) for note, who in methods.items()}


def shown_values(
    scores: Sequence[ScoreColumn], numbers: Result | Reference
) -> dict[str, dict[str, float]]:
    """Return scores as tables show them, by scene, with `OVERALL` for the average, then by key."""
    by_key = {score.key: score for score in scores}
    parts = {OVERALL: numbers.overall} | numbers.scenes
    return {
        scene: {key: as_shown(by_key[key], value) for key, value in part.items()}
        for scene, part in parts.items()
    }


def as_shown(score: ScoreColumn, value: float) -> float:
    """Turn a result's value into what tables show: percent for a share."""
    return share_to_percent(value) if score.unit == "share" else value


def score_column(score: ScoreColumn, group: str = "", block: str = "") -> Column:
    """Return a score's column."""
    unit = UNITS[score.unit]
    return Column(score.title, unit, score.higher_is_better, group=group, block=block)


def identity(result: Result) -> str:
    """Return what a result's numbers depend on, in one line."""
    return (
        f"protocol {result.protocol.fingerprint[:12]}, truth {result.truth.fingerprint[:12]}, "
        f"airzoo-bench {result.versions['airzoo-bench']}"
    )
