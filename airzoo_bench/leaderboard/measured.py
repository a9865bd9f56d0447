"""The numbers that a board takes of results: scores, intervals, conditions, values to compare.

They lie in a folder beside the site by the hash of result and records, so that a build measures
only changed results. Whatever cannot be read there is measured again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.version import __version__
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.data_branch import (
    ANSWER_FILE,
    FAULT_FILE,
    Estimate,
    read_answer,
    read_run,
    run_folders,
)
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission
from airzoo_bench.results.comparison import make_sample, score_intervals
from airzoo_bench.results.files import records_path
from airzoo_bench.results.records import Scored, read_records
from airzoo_bench.results.result import Result, ScoreColumn, read_result
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import (
    condition_names,
    condition_title,
    group_averages,
    group_records,
)

__all__ = [
    "OVERALL",
    "RESAMPLING",
    "RESULT_FILE",
    "Entry",
    "Measured",
    "Number",
    "forget_others",
    "load_arrays",
    "measure",
    "read_entries",
    "store_arrays",
]

OVERALL = ""
RESAMPLING = ResamplingConfig()
RESULT_FILE = "result.json"

Number = Sequence[float | None]
"""A score: its value, its interval, its standard error."""

_FORMAT = "6"
_NORMAL = 1.959964


@dataclass(frozen=True, eq=False)
class Measured:
    """The numbers of a result, and what they depend on.

    Scores are by scene, with `OVERALL` for the average, then by key. `groups` are the names and
    sizes of the parts of `values` (V, N), a row a headline score; a sealed answer has none.
    `queries` is a hash of the names of all records, `key` the name of these numbers in the cache.
    """

    track: str
    protocol: str
    protocol_version: int
    protocol_fingerprint: str
    benchmark: str
    truth: str
    method: str
    made_with: str
    columns: list[dict[str, Any]]
    scenes: list[dict[str, Any]]
    scores: dict[str, dict[str, Number]]
    benchmark_version: int | None = None
    sealed: bool = False
    unit: str = "query"
    notes: list[str] = field(default_factory=list)
    interval_kinds: list[str] = field(default_factory=list)
    references: dict[str, Any] = field(default_factory=dict)
    conditions: list[dict[str, Any]] = field(default_factory=list)
    groups: list[tuple[str, int]] = field(default_factory=list)
    queries: str = ""
    values: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    key: str = ""

    @property
    def measures(self) -> tuple[Any, ...]:
        """The settings that numbers ranked together must share."""
        protocol = (self.protocol, self.protocol_version, self.protocol_fingerprint)
        return (*protocol, self.truth, self.sealed)

    @cached_property
    def score_columns(self) -> list[ScoreColumn]:
        """The scores, headline ones first."""
        found = [ScoreColumn(**column) for column in self.columns]
        return sorted(found, key=lambda column: not column.headline)

    def overall(self, key: str) -> Number:
        """Return the average over scenes; infinite where there is none."""
        return self.scores[OVERALL].get(key, (np.inf, None, None, None))

    def values_of(self, key: str) -> Floats:
        """Return the values (N,) of a headline score."""
        headline = [one["key"] for one in self.columns if one["headline"]]
        found: Floats = self.values[headline.index(key)]
        return found


def measure(file: Path, cache: Path) -> Measured:
    """Measure a result or a sealed answer, or take it from the cache."""
    content = b"".join(
        part.read_bytes() if part.is_file() else b""
        for part in (file, records_path(file))  # records are held to the hash in the result
    )
    key = hashlib.sha256(f"{_FORMAT} {__version__} {file.name}".encode() + content).hexdigest()
    path = cache / f"{key}.npz"
    if arrays := load_arrays(path):
        facts = json.loads(arrays["facts"].tobytes())
        return Measured(**facts, values=arrays["values"], key=key)
    found = _of_answer(file) if file.name == ANSWER_FILE else _of_result(file)
    facts = asdict(replace(found, values=np.zeros(0)))
    del facts["values"], facts["key"]
    text = np.frombuffer(json.dumps(facts).encode(), np.uint8)
    store_arrays(path, {"facts": text, "values": found.values})
    return replace(found, key=key)


def store_arrays(path: Path, arrays: dict[str, Any]) -> None:
    """Write arrays to the cache."""
    with atomic_write(path) as stream:
        write_npz(stream, arrays)


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
    found = score_intervals(method, headline, RESAMPLING)
    scores: dict[str, dict[str, Number]] = {
        scene: {key: (value, None, None, None) for key, value in part.items()}
        for scene, part in ({OVERALL: result.overall} | result.scenes).items()
    }
    kinds = set()
    for scene, row in ({OVERALL: found.overall} | found.groups).items():
        for column, one in zip(headline, row, strict=True):
            scores[scene][column.key] = (scores[scene][column.key][0], one.low, one.high, None)
            kinds |= {one.method} - {""}
    sample = make_sample([method], headline)
    return Measured(
        track=result.track,
        protocol=result.protocol.name,
        protocol_version=result.protocol.version,
        protocol_fingerprint=result.protocol.fingerprint,
        benchmark=result.truth.benchmark,
        benchmark_version=result.truth.version,
        truth=result.truth.fingerprint,
        unit=result.unit,
        method=result.predictions.method,
        made_with=result.versions["airzoo-bench"],
        columns=[column.model_dump() for column in result.columns],
        scenes=_scenes(result.truth.scene_titles, {s: c["queries"] for s, c in _counts(result)}),
        notes=list(result.notes),
        scores=scores,
        interval_kinds=sorted(kinds),
        references={name: part.model_dump() for name, part in result.references.items()},
        conditions=[*_conditions(method, headline)],
        groups=[(g, v.shape[1]) for g, v in zip(sample.groups, sample.values, strict=True)],
        queries=hashlib.sha256("\n".join(method.records["query"].astype(str)).encode()).hexdigest(),
        values=np.concatenate(sample.values, axis=1),
    )


def _counts(result: Result) -> Iterator[tuple[str, dict[str, int]]]:
    yield from ((scene, result.counts[scene]) for scene in result.scenes)


def _scenes(titles: dict[str, str], queries: dict[str, int]) -> list[dict[str, Any]]:
    return [{"id": s, "title": titles[s], "queries": count} for s, count in queries.items()]


def _conditions(method: Scored, scores: Sequence[ScoreColumn]) -> Iterator[dict[str, Any]]:
    """Yield the headline scores within the groups of every condition, over all scenes."""
    if method.result.unit != "query" or not scores:
        return
    values = np.array([method.records[score.key].to_numpy(np.float64) for score in scores])
    medians = np.array([score.average == "median" for score in scores])
    for by in condition_names(method):
        grouping = group_records(method.records, by)
        means = group_averages(values, medians, grouping.codes, len(grouping.labels))
        yield {
            "by": by,
            "title": condition_title(by),
            "labels": list(grouping.labels),
            "counts": grouping.counts.tolist(),
            "members": hashlib.sha256(grouping.codes.tobytes()).hexdigest(),
            "values": {s.key: row.tolist() for s, row in zip(scores, means, strict=True)},
        }


def _of_answer(file: Path) -> Measured:
    answer = read_answer(file.parent)
    return Measured(
        track=answer.track,
        protocol=answer.protocol,
        protocol_version=answer.protocol_version,
        protocol_fingerprint=answer.protocol_fingerprint,
        benchmark=answer.benchmark,
        truth=answer.truth_commitment,
        sealed=True,
        method=answer.method,
        made_with=answer.versions.get("airzoo-bench", ""),
        columns=[column.model_dump() for column in answer.columns],
        scenes=_scenes(answer.scene_titles, answer.queries),
        scores={
            scene: {c.key: _estimated(part[c.key], c) for c in answer.columns if c.key in part}
            for scene, part in ({OVERALL: answer.overall} | answer.scenes).items()
        },
    )


def _estimated(estimate: Estimate, column: ScoreColumn) -> Number:
    """Return a rounded score with the interval of its standard error; no value is infinite."""
    value, error = estimate.value, estimate.standard_error
    if value is None or error is None:
        return (np.inf if value is None else value), None, None, error
    most = 1.0 if column.unit == "share" else np.inf
    reach = _NORMAL * error
    return value, max(0.0, value - reach), float(min(most, value + reach)), error


# --- entries ---


@dataclass(frozen=True, eq=False)
class Entry:
    """A version of a submission, or a plain result, which has no place.

    `number` is that of its version, `scored` the date of scoring. `reason` says why `measured` is
    None. `older` are the earlier versions that can be shown, the newest first.
    """

    place: Place | None
    number: int = 0
    submission: Submission | None = None
    scored: str | None = None
    measured: Measured | None = None
    reason: str = ""
    older: tuple[Entry, ...] = ()

    @property
    def method(self) -> str:
        """The method's name in tables."""
        if self.submission is not None:
            return self.submission.method
        return self.measured.method if self.measured else self.place.folder if self.place else ""


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
        if place[:2] != (measured.benchmark, measured.track):
            raise SubmissionError(f"is of {measured.benchmark} ({measured.track})")
        if stated.protocol != measured.protocol:
            raise SubmissionError(
                f"scored by {measured.protocol}, but submitted for {stated.protocol}"
            )
        scored = read_run(folder).scored.date().isoformat()
    except UserError as error:
        return replace(entry, reason=_reason(error))
    return replace(entry, scored=scored, measured=measured)


def _reason(error: UserError) -> str:
    """Return what is wrong in one line, with the name of the file but not where it lies."""
    where = "" if error.where is None else f"{Path(error.where).name}: "
    return f"{where}{error.what}".replace("\n", " ")
