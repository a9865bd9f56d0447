"""The parts of board.json, and the numbers that a board takes of each result.

Numbers lie in a folder beside the site by the hash of result and records, so that a build measures
only changed results. Whatever cannot be read there is measured again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal
from zipfile import BadZipFile

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.files import atomic_write, read_text, write_npz
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.data_branch import (
    ANSWER_FILE,
    FAULT_FILE,
    RESULT_FILE,
    read_facts,
    run_folders,
)
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.comparison import make_sample, score_intervals
from airzoo_bench.results.records import Scored, read_records
from airzoo_bench.results.result import Reference, Result, ScoreColumn, read_result
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import (
    condition_names,
    condition_title,
    group_averages,
    group_records,
)
from airzoo_bench.tables.intervals import intervals_made, resampled

Number = float | None

_RESAMPLING = ResamplingConfig()
_FORMAT = "9"
_NONE = (None, None)

# --- board.json ---


class Model(BaseModel):
    """A part of board.json, in which an infinite number is the text "Infinity"."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="strings")


class Score(Model):
    """A score with its interval, its standard error where the truth is sealed, and its ranks.

    `near_best` says that a test of the two alone cannot tell the method from the best.
    """

    value: Number = None
    low: Number = None
    high: Number = None
    standard_error: Number = None
    rank: tuple[int, int] | None = None
    near_best: bool = False


class Version(Model):
    """A version of a submission: its overall scores, and where its run lies on the data branch."""

    number: int
    date: str
    scores: dict[str, Number]
    files: str


class Row(Model):
    """A method scored here, reported by a paper or not scored, or a floor such as chance.

    Scores are by key, `scenes` by scene, then key: value, low and high; `conditions` by condition,
    then key: a value a group. The newest version comes first in `history`.
    """

    id: str = ""
    kind: Literal["re-scored", "sealed", "reported", "floor", "failed"]
    method: str
    team: str = ""
    authors: tuple[str, ...] = ()
    summary: str = ""
    source: str = ""
    reason: str = ""
    date: str | None = None
    rescored: str | None = None
    version: int | None = None
    paper: str | None = None
    code: str | None = None
    weights: str | None = None
    licence: str | None = None
    training_data: tuple[str, ...] | None = None
    stages: str | None = None
    uses: tuple[str, ...] = ()
    bibtex: str = ""
    notes: tuple[str, ...] = ()
    scores: dict[str, Score] = {}
    scenes: dict[str, dict[str, tuple[Number, Number, Number]]] = {}
    conditions: dict[str, dict[str, tuple[Number, ...]]] = {}
    history: tuple[Version, ...] = ()


class Scene(Model):
    """A scene of a table."""

    id: str
    title: str
    queries: int | None


class Conditions(Model):
    """The groups of queries by a condition, and how many queries each has."""

    by: str
    title: str
    labels: tuple[str, ...]
    counts: tuple[int, ...]


class Head(Model):
    """The benchmark, protocol and truth of all numbers in a table."""

    benchmark: str
    benchmark_version: int | None = None
    track: str
    protocol: str
    protocol_version: int
    protocol_fingerprint: str
    truth: str = ""
    sealed: bool = False
    unit: str = "query"
    scenes: tuple[Scene, ...]


class Table(Head):
    """A table of the board.

    `pairs` are by score: the ids of the ranked methods, and of every two of them low, high, p and
    p_holm, the upper triangle as float32 (little endian), deflated, in base64.
    """

    id: str
    title: str
    summary: str
    benchmark_title: str
    scores: tuple[ScoreColumn, ...]
    conditions: tuple[Conditions, ...] = ()
    rows: tuple[Row, ...] = ()
    pairs: dict[str, dict[str, Any]] = {}
    about_intervals: str = ""
    notes: tuple[str, ...] = ()
    data: str | None = None
    paper: str | None = None


# --- a result ---


class Measured(Model):
    """The numbers of a result, or the answer of a sealed truth.

    `row` has its scores, `floors` those without a method. `groups` are the names and sizes of the
    parts of `values` (V, N), a row a headline score; `key` names these numbers in the cache.
    """

    head: Head
    made_with: str
    columns: tuple[ScoreColumn, ...]
    row: Row
    floors: tuple[Row, ...] = ()
    about_intervals: str = ""
    conditions: tuple[Conditions, ...] = ()
    groups: tuple[tuple[str, int], ...] = ()
    values: Any = Field(default=None, exclude=True)
    key: str = Field(default="", exclude=True)


def read_answer(path: Path) -> Measured:
    """Read the answer of a sealed truth."""
    try:
        return Measured.model_validate_json(read_text(path, SubmissionError, "sealed answer"))
    except ValidationError as error:
        raise SubmissionError("not the answer of a sealed truth", where=path) from error


def measure(run: Path, cache: Path) -> Measured:
    """Measure the result of a run, or take it from the cache; or read its sealed answer."""
    files = [run / RESULT_FILE, run / "records.csv", run / ANSWER_FILE]
    content = b"".join(path.read_bytes() for path in files if path.is_file())
    key = hashlib.sha256(f"{_FORMAT} {__version__}".encode() + content).hexdigest()
    if files[2].is_file():
        return read_answer(files[2]).model_copy(update={"key": key})
    if arrays := load_arrays(cache / f"{key}.npz"):
        found = Measured.model_validate_json(arrays["facts"].tobytes())
        return found.model_copy(update={"values": arrays["values"], "key": key})
    result = read_result(files[0])
    found = _measured(Scored(result.predictions.method, result, read_records(files[0], result)))
    text = np.frombuffer(found.model_dump_json().encode(), np.uint8)
    store_arrays(cache / f"{key}.npz", {"facts": text, "values": found.values})
    return found.model_copy(update={"key": key})


def store_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays to the cache."""
    with atomic_write(path) as stream:
        write_npz(stream, dict(arrays))


def load_arrays(path: Path) -> dict[str, Any]:
    """Return arrays of the cache; none where they are missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as found:
            return dict(found)
    except (OSError, EOFError, ValueError, KeyError, NotImplementedError, BadZipFile):
        return {}


def _measured(method: Scored) -> Measured:
    """Measure a result with its records."""
    result = method.result
    headline = [column for column in result.columns if column.headline]
    found = score_intervals(method, headline, _RESAMPLING)
    sample = make_sample([method], headline)
    made = [one for part in (found.overall, *found.groups.values()) for one in part]
    about = intervals_made(made, _RESAMPLING, resampled(result.unit))
    limits = {
        scene: {c.key: (one.low, one.high) for c, one in zip(headline, part, strict=False)}
        for scene, part in {"": found.overall, **found.groups}.items()
    }
    conditions, by_condition = _by_condition(method, headline)
    row = Row(
        kind="re-scored",
        method=method.name,
        notes=result.notes,
        scores={
            key: Score(
                value=value, low=limits[""].get(key, _NONE)[0], high=limits[""].get(key, _NONE)[1]
            )
            for key, value in result.overall.items()
        },
        scenes={
            scene: {
                key: (value, *limits.get(scene, {}).get(key, _NONE)) for key, value in part.items()
            }
            for scene, part in result.scenes.items()
        },
        conditions=by_condition,
    )
    return Measured(
        head=head_of(result),
        made_with=result.versions["airzoo-bench"],
        columns=result.columns,
        row=row,
        floors=tuple(_floor(name, part) for name, part in result.references.items()),
        about_intervals=f"{about}." if about else "No intervals: too few queries or scenes.",
        conditions=conditions,
        groups=tuple((g, v.shape[1]) for g, v in zip(sample.groups, sample.values, strict=True)),
        values=np.concatenate(sample.values, axis=1),
    )


def head_of(result: Result) -> Head:
    """Return what a result measures."""
    truth, titles = result.truth, result.truth.scene_titles
    return Head(
        benchmark=truth.benchmark,
        benchmark_version=truth.version,
        track=result.track,
        protocol=result.protocol.name,
        protocol_version=result.protocol.version,
        protocol_fingerprint=result.protocol.fingerprint,
        truth=truth.fingerprint,
        unit=result.unit,
        scenes=tuple(
            Scene(id=scene, title=titles[scene], queries=result.counts[scene]["queries"])
            for scene in result.scenes
        ),
    )


def _floor(name: str, part: Reference) -> Row:
    return Row(
        kind="floor",
        method=name,
        source=part.meaning,
        scores={key: Score(value=value) for key, value in part.overall.items()},
        scenes={
            scene: {key: (value, None, None) for key, value in numbers.items()}
            for scene, numbers in part.scenes.items()
        },
    )


def _by_condition(
    method: Scored, scores: Sequence[ScoreColumn]
) -> tuple[tuple[Conditions, ...], dict[str, dict[str, tuple[Number, ...]]]]:
    """Return conditions, and headline scores by their groups."""
    conditions, found = [], {}
    if method.result.unit != "query" or not scores:
        return (), {}
    values = np.array([method.records[score.key].to_numpy(np.float64) for score in scores])
    medians = np.array([score.average == "median" for score in scores])
    for by in condition_names(method):
        grouping = group_records(method.records, by)
        means = group_averages(values, medians, grouping.codes, len(grouping.labels)).tolist()
        conditions.append(
            Conditions(
                by=by,
                title=condition_title(by),
                labels=grouping.labels,
                counts=tuple(grouping.counts.tolist()),
            )
        )
        found[by] = {
            score.key: tuple(None if np.isnan(one) else one for one in row)
            for score, row in zip(scores, means, strict=True)
        }
    return tuple(conditions), found


# --- entries ---


@dataclass(frozen=True, eq=False)
class Entry:
    """A version of a submission: `scored` on a date, or with the reason why it is not `measured`.

    `older` are the earlier versions that can be shown, the newest first.
    """

    place: Place
    number: int = 0
    submission: Submission | None = None
    scored: str = ""
    measured: Measured | None = None
    reason: str = ""
    older: tuple[Entry, ...] = ()

    @property
    def method(self) -> str:
        """The method's name in tables."""
        return self.submission.method if self.submission is not None else self.place.folder


def read_entries(runs: Path, submissions: Path, cache: Path) -> list[Entry]:
    """Read the submissions below a folder of runs, and those that have no run yet.

    An entry that cannot be shown has a reason instead, and keeps no other from the board.
    """
    found: dict[Place, Entry] = {}
    for folder in sorted(path for path in runs.glob("*/*/*") if path.is_dir()):
        place = Place.of_folder(folder)
        if place.is_plain and (entry := _newest(folder, place, cache)):
            found[place] = entry
    for path in sorted(submissions.glob(f"*/*/*/{SUBMISSION_FILE}")):
        place = Place.of_folder(path.parent)
        if place in found or not place.is_plain:
            continue
        try:
            found[place] = Entry(place, 0, read_submission(path).public(), reason="not scored yet")
        except UserError as error:
            found[place] = Entry(place, reason=_reason(error))
    return list(found.values())


def entries_of(entries: Sequence[Entry], protocol: Protocol) -> list[Entry]:
    """Return the entries of a protocol's table, also entries with an unreadable submission.toml."""
    return [
        entry
        for entry in entries
        if entry.place[:2] == (protocol.benchmark, protocol.track)
        and (entry.submission is None or entry.submission.protocol == protocol.name)
    ]


def _newest(folder: Path, place: Place, cache: Path) -> Entry | None:
    """Return the newest version that can be shown, else the reason why none can."""
    versions = [_read_version(path, place, cache) for path in run_folders(folder)]
    reasons = [f"version {one.number}: {one.reason}" for one in versions if one.reason]
    if (folder / FAULT_FILE).is_file():  # CI could not score the files that were merged last
        reasons.insert(0, (folder / FAULT_FILE).read_text(encoding="utf-8").strip())
    shown = [one for one in versions if one.measured is not None]
    if shown:
        why = f"a later version is not shown: {reasons[0]}" if reasons else ""
        return replace(shown[0], older=tuple(shown[1:]), reason=why)
    stated = versions[0].submission if versions else None
    return Entry(place, submission=stated, reason=reasons[0]) if reasons else None


def _read_version(run: Path, place: Place, cache: Path) -> Entry:
    entry = Entry(place, int(run.name))
    try:
        entry = replace(entry, submission=read_submission(run / SUBMISSION_FILE, public=True))
        scored = read_facts(run).scored.date().isoformat()
        return replace(entry, scored=scored, measured=measure(run, cache))
    except UserError as error:
        return replace(entry, reason=_reason(error))


def _reason(error: UserError) -> str:
    """Return what is wrong in one line, with the name of the file but not where it lies."""
    where = "" if error.where is None else f"{Path(error.where).name}: "
    return f"{where}{error.what}".replace("\n", " ")
