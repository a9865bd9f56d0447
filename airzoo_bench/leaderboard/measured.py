"""The numbers that a board takes of results: scores, intervals, conditions, values to compare.

They lie in a folder beside the site by the hash of result and records, so that a build measures
only changed results. Whatever cannot be read there is measured again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal
from zipfile import BadZipFile

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.data_branch import (
    ANSWER_FILE,
    FAULT_FILE,
    Estimate,
    SealedAnswer,
    read_answer,
    read_run,
    run_folders,
)
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.comparison import make_sample, score_intervals
from airzoo_bench.results.files import records_path
from airzoo_bench.results.records import Scored, read_records
from airzoo_bench.results.result import Reference, ScoreColumn, read_result
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import (
    condition_names,
    condition_title,
    group_averages,
    group_records,
)
from airzoo_bench.tables.intervals import intervals_made, resampled

OVERALL = ""
"""The key of the average over scenes."""

Number = float | None


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


RESULT_FILE = "result.json"

_RESAMPLING = ResamplingConfig()
_FORMAT = "7"
_NORMAL = 1.959964
_SEALED = "95 % intervals: the rounded score and 1.96 rounded standard errors to each side."


class Grouped(Conditions):
    """Headline scores by the groups of a condition; `members` is a hash of who is in which."""

    members: str
    values: dict[str, tuple[float | None, ...]]


class Measured(Model):
    """The numbers of a result, and what they depend on.

    Scores are by scene, with `OVERALL` for the average, then by key. `groups` are the names and
    sizes of the parts of `values` (V, N), a row a headline score; a sealed answer has none.
    `queries` is a hash of the names of all records, `key` the name of these numbers in the cache.
    """

    head: Head
    made_with: str
    columns: tuple[ScoreColumn, ...]
    scores: dict[str, dict[str, Score]]
    notes: tuple[str, ...] = ()
    about_intervals: str = _SEALED
    references: dict[str, Reference] = Field(default_factory=dict)
    conditions: tuple[Grouped, ...] = ()
    groups: tuple[tuple[str, int], ...] = ()
    queries: str = ""
    values: Any = Field(default=None, exclude=True)
    key: str = Field(default="", exclude=True)


def measure(file: Path, cache: Path) -> Measured:
    """Measure a result or a sealed answer, or take it from the cache."""
    parts = [part for part in (file, records_path(file)) if part.is_file()]
    content = b"".join(part.read_bytes() for part in parts)
    key = hashlib.sha256(f"{_FORMAT} {__version__} {file.name}".encode() + content).hexdigest()
    path = cache / f"{key}.npz"
    if arrays := load_arrays(path):
        found = Measured.model_validate_json(arrays["facts"].tobytes())
        return found.model_copy(update={"values": arrays["values"], "key": key})
    found = (
        measure_answer(read_answer(file.parent)) if file.name == ANSWER_FILE else _of_result(file)
    )
    text = np.frombuffer(found.model_dump_json().encode(), np.uint8)
    values = np.zeros((0, 0)) if found.values is None else found.values
    store_arrays(path, {"facts": text, "values": values})
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


def forget_others(keys: Collection[str], cache: Path) -> None:
    """Remove from the cache results that are not among these."""
    for file in cache.glob("*.npz"):
        if len(file.stem) == 64 and file.stem not in keys:
            file.unlink()


def _of_result(file: Path) -> Measured:
    result = read_result(file)
    method = Scored(result.predictions.method, result, read_records(file, result))
    headline = [column for column in result.columns if column.headline]
    intervals = score_intervals(method, headline, _RESAMPLING)
    by_scene = {OVERALL: intervals.overall} | intervals.groups
    sample, records = make_sample([method], headline), method.records["query"].astype(str)
    made: list[Interval] = [one for row in by_scene.values() for one in row]
    about = intervals_made(made, _RESAMPLING, resampled(result.unit))
    return Measured(
        head=Head(
            benchmark=result.truth.benchmark,
            benchmark_version=result.truth.version,
            track=result.track,
            protocol=result.protocol.name,
            protocol_version=result.protocol.version,
            protocol_fingerprint=result.protocol.fingerprint,
            truth=result.truth.fingerprint,
            unit=result.unit,
            scenes=tuple(
                Scene(
                    id=scene,
                    title=result.truth.scene_titles[scene],
                    queries=result.counts[scene]["queries"],
                )
                for scene in result.scenes
            ),
        ),
        made_with=result.versions["airzoo-bench"],
        columns=result.columns,
        scores={
            scene: _with_intervals(part, headline, by_scene.get(scene, ()))
            for scene, part in ({OVERALL: result.overall} | result.scenes).items()
        },
        notes=result.notes,
        about_intervals=f"{about}." if about else "No intervals: too few queries or scenes.",
        references=result.references,
        conditions=tuple(_conditions(method, headline)),
        groups=tuple((g, v.shape[1]) for g, v in zip(sample.groups, sample.values, strict=True)),
        queries=hashlib.sha256("\n".join(records).encode()).hexdigest(),
        values=np.concatenate(sample.values, axis=1),
    )


def _with_intervals(
    part: Mapping[str, float], headline: Sequence[ScoreColumn], found: Sequence[Interval]
) -> dict[str, Score]:
    limits = {c.key: (one.low, one.high) for c, one in zip(headline, found, strict=False)}
    none = (None, None)
    return {
        key: Score(value=value, low=limits.get(key, none)[0], high=limits.get(key, none)[1])
        for key, value in part.items()
    }


def _conditions(method: Scored, scores: Sequence[ScoreColumn]) -> Iterator[Grouped]:
    """Yield the headline scores within the groups of every condition, over all scenes."""
    if method.result.unit != "query" or not scores:
        return
    values = np.array([method.records[score.key].to_numpy(np.float64) for score in scores])
    medians = np.array([score.average == "median" for score in scores])
    for by in condition_names(method):
        grouping = group_records(method.records, by)
        means = group_averages(values, medians, grouping.codes, len(grouping.labels))
        shown = [[None if np.isnan(one) else one for one in row] for row in means.tolist()]
        yield Grouped(
            by=by,
            title=condition_title(by),
            labels=grouping.labels,
            counts=tuple(grouping.counts.tolist()),
            members=hashlib.sha256(grouping.codes.tobytes()).hexdigest(),
            values={s.key: tuple(row) for s, row in zip(scores, shown, strict=True)},
        )


def measure_answer(answer: SealedAnswer) -> Measured:
    """Return the numbers of a sealed answer."""
    return Measured(
        head=Head(
            benchmark=answer.benchmark,
            track=answer.track,
            protocol=answer.protocol,
            protocol_version=answer.protocol_version,
            protocol_fingerprint=answer.protocol_fingerprint,
            truth=answer.truth_commitment,
            sealed=True,
            scenes=tuple(
                Scene(id=scene, title=answer.scene_titles[scene], queries=count)
                for scene, count in answer.queries.items()
            ),
        ),
        made_with=answer.versions.get("airzoo-bench", ""),
        columns=answer.columns,
        scores={
            OVERALL: {
                c.key: _estimated(answer.overall[c.key], c)
                for c in answer.columns
                if c.key in answer.overall
            }
        },
    )


def _estimated(estimate: Estimate, column: ScoreColumn) -> Score:
    """Return a rounded score with the interval of its standard error; no value is infinite."""
    value, error = estimate.value, estimate.standard_error
    if value is None or error is None:
        return Score(value=np.inf if value is None else value, standard_error=error)
    most = 1.0 if column.unit == "share" else np.inf
    low, high = max(0.0, value - _NORMAL * error), float(min(most, value + _NORMAL * error))
    return Score(value=value, low=low, high=high, standard_error=error)


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


def read_entries(
    runs: Path, submissions: Path, cache: Path, note: Callable[[str], None]
) -> list[Entry]:
    """Read the submissions below a folder of runs, and those that have no run yet.

    An entry that cannot be shown has a reason instead, and keeps no other from the board.
    """
    found: dict[Place, Entry] = {}
    for folder in sorted(path for path in runs.glob("*/*/*") if path.is_dir()):
        place = Place.of_folder(folder)
        entry = _newest(folder, place, cache, note) if place.is_plain else None
        if entry is None:
            note(f"{folder}: no submission, and skipped")
        else:
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
    """Return the entries of a protocol's table, also those whose submission.toml is unreadable."""
    return [
        entry
        for entry in entries
        if entry.place[:2] == (protocol.benchmark, protocol.track)
        and (entry.submission is None or entry.submission.protocol == protocol.name)
    ]


def _newest(folder: Path, place: Place, cache: Path, note: Callable[[str], None]) -> Entry | None:
    """Return the newest version that can be shown, else the reason why none can."""
    versions = [_version(path, place, cache) for path in run_folders(folder)]
    reasons = [f"version {one.number}: {one.reason}" for one in versions if one.reason]
    if (folder / FAULT_FILE).is_file():  # CI could not score the files that were merged last
        reasons.insert(0, (folder / FAULT_FILE).read_text(encoding="utf-8").strip())
    for reason in reasons:
        note(f"{place.path}: {reason}")
    shown = [one for one in versions if one.measured is not None]
    if shown:
        why = f"a later version is not shown: {reasons[0]}" if reasons else ""
        return replace(shown[0], older=tuple(shown[1:]), reason=why)
    stated = versions[0].submission if versions else None
    return Entry(place, submission=stated, reason=reasons[0]) if reasons else None


def _version(folder: Path, place: Place, cache: Path) -> Entry:
    entry = Entry(place, int(folder.name))
    try:
        files = [folder / name for name in (RESULT_FILE, ANSWER_FILE) if (folder / name).is_file()]
        stated = read_submission(folder / SUBMISSION_FILE, public=True)
        entry = replace(entry, submission=stated)
        if len(files) != 1:
            raise SubmissionError(f"holds {len(files)} of {RESULT_FILE} and {ANSWER_FILE}")
        measured = measure(files[0], cache)
        # Numbers of another folder or protocol would be shown under a wrong name.
        head = measured.head
        if (*place[:2], stated.protocol) != (head.benchmark, head.track, head.protocol):
            raise SubmissionError(
                f"scored by {head.protocol} of {head.benchmark} ({head.track}), but submitted for "
                f"{stated.protocol} in {place.path}"
            )
        scored = read_run(folder).scored.date().isoformat()
    except UserError as error:
        return replace(entry, reason=_reason(error))
    return replace(entry, scored=scored, measured=measured)


def _reason(error: UserError) -> str:
    """Return what is wrong in one line, with the name of the file but not where it lies."""
    where = "" if error.where is None else f"{Path(error.where).name}: "
    return f"{where}{error.what}".replace("\n", " ")
