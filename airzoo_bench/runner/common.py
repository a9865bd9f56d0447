"""What all tracks share on the way from files to a result."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar
from typing import Protocol as Structural

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark import Benchmark
from airzoo_bench.errors import (
    BenchmarkError,
    PredictionError,
    ProtocolError,
    ResultError,
    first_of,
)
from airzoo_bench.files import atomic_entries, check_output_folder, fingerprint, sha256_of_tree
from airzoo_bench.ids import assign_queries, scene_of, with_endings
from airzoo_bench.protocol import Protocol, find_protocol, load_protocol, protocol_files
from airzoo_bench.readers.arrays import open_arrays, protocol_name
from airzoo_bench.result import (
    PredictionsUsed,
    ProtocolUsed,
    Reference,
    Result,
    TruthUsed,
    read_result,
    score_columns,
    versions,
    with_summary,
    write_result,
)
from airzoo_bench.scores import Score, summarise

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "RESULT_FILES",
    "RUN_FILES",
    "Checked",
    "Evaluation",
    "Run",
    "check_against_benchmark",
    "choose_protocol",
    "common_notes",
    "concatenate",
    "earlier_run",
    "make_result",
    "match_queries",
    "other_benchmark",
    "refuse_other_track",
    "save",
]

RUN_FILES = ("result.json", "records.csv", "timings.csv", "alignment.json", "figures", "clouds")
"""What a run can leave in its folder."""

RESULT_FILES = RUN_FILES[:4]
"""Those of `RUN_FILES` that are files."""

P = TypeVar("P", bound=Protocol)


@dataclass(frozen=True)
class Evaluation:
    """A result and the records that it was made from."""

    result: Result
    records: pd.DataFrame


@dataclass(frozen=True)
class Run:
    """What was run: predictions by a protocol on a benchmark.

    Attributes
    ----------
    path : Path
        Of the predictions.
    method : str
        What tables call them.
    kind : str
        What the predictions hold.
    protocol : Protocol
    benchmark : Benchmark
    truths : dict of str to str
        Fingerprints of the truth by scene.
    """

    path: Path
    method: str
    kind: str
    protocol: Protocol
    benchmark: Benchmark
    truths: dict[str, str]


def save(evaluation: Evaluation, folder: Path, *writers: Callable[[Path], None]) -> None:
    """Write ``result.json`` and ``records.csv`` into a folder, in place of an earlier run's files.

    Everything is written first, then exchanged in one step: nothing of the two runs is ever mixed.

    Parameters
    ----------
    evaluation : Evaluation
    folder : Path
        What is not of `RUN_FILES` stays.
    writers : callables
        Each takes a folder and writes one more of `RUN_FILES` into it.
    """
    check_output_folder(folder, RESULT_FILES)
    content = evaluation.records.to_csv(index=False, lineterminator="\n").encode()
    result = evaluation.result.with_records(hashlib.sha256(content).hexdigest())
    with atomic_entries(folder, RUN_FILES) as staged:
        (staged / "records.csv").write_bytes(content)
        write_result(staged / "result.json", result)
        for write in writers:
            write(staged)


def earlier_run(folder: Path, track: str) -> str | None:
    """Say what a run of another track has left in a folder, which `save` will replace."""
    try:
        found = read_result(folder / "result.json").track
    except ResultError:  # none, or one that nobody can read any more
        return None
    if found == track:
        return None
    names = ", ".join(name for name in RUN_FILES if (folder / name).exists())
    return f"{folder} holds a run of the {found} track; {names} will be replaced"


def choose_protocol(
    path: Path, in_file: str | None, named: str | None, data: Path, model: type[P]
) -> P:
    """Return the protocol that was named, else the one that the file names.

    Raises
    ------
    PredictionError
        Neither names one, or it is of another track.
    ProtocolError
        It is unknown.
    """
    if named is not None:
        chosen = find_protocol(named, data)
    elif in_file is not None:
        try:
            chosen = find_protocol(in_file, data)
        except ProtocolError as error:
            raise error.inside(f"{path}, field 'protocol'") from error
    else:
        raise PredictionError(
            "does not say which protocol it is for",
            where=path,
            expected="a field 'protocol' with the name of one",
            mend="name it with --protocol, or add the field; `airzoo-bench protocols` lists them",
        )
    if not isinstance(chosen, model):
        raise PredictionError(
            f"protocol {chosen.name} is of the {chosen.track} track",
            where=path,
            expected="a protocol of the track that was asked for",
            mend=f"airzoo-bench eval {chosen.track} {path}",
        )
    return chosen


def refuse_other_track(
    path: Path, named: str | None, data: Path, model: type[P], memory_bytes: int
) -> None:
    """Refuse an ``.npz`` that names a protocol of another track, before its fields are read.

    Raises
    ------
    PredictionError
        The message names the right command, not the fields that the file lacks for this one.
    """
    if named is None and path.suffix == ".npz" and path.is_file():
        in_file = protocol_name(open_arrays(path, memory_bytes))
        if in_file is not None:
            choose_protocol(path, in_file, None, data, model)


def concatenate(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Put the records of scenes under each other."""
    import pandas as pd

    return pd.concat(parts, ignore_index=True)


@dataclass(frozen=True)
class Checked:
    """What a check found: faults, and what a person may wish to know besides."""

    faults: list[PredictionError]
    notes: list[str]


class HasQueries(Structural):
    """The truth of a scene, of whatever track."""

    @property
    def queries(self) -> pd.DataFrame:
        """A row a query, with its ``id``."""


T = TypeVar("T", bound=HasQueries)


def match_queries(
    path: Path,
    ids: NDArray[np.str_],
    protocol: Protocol,
    data: Path,
    truths: Sequence[HasQueries],
) -> tuple[list[NDArray[np.intp]], int]:
    """Find the row of the predictions that answers each query; see `ids.assign_queries`.

    Raises
    ------
    PredictionError
        No id is a query; the message says which benchmark they look like.
    """
    rows, extra = assign_queries(ids, [truth.queries["id"] for truth in truths])
    if all((found < 0).all() for found in rows):
        example = str(truths[0].queries["id"].iloc[0])
        raise other_benchmark(path, ids, protocol, data, example)
    return rows, extra


def check_against_benchmark(
    path: Path,
    ids: NDArray[np.str_],
    protocol: Protocol,
    data: Path,
    read: Callable[[], list[T]],
    hold: Callable[[T, NDArray[np.intp]], object],
    suspect: Callable[[list[T]], list[str]] = lambda _: [],
) -> Checked:
    """Hold predictions against the benchmark folder, where it is there.

    Parameters
    ----------
    path, ids : Path, (N,) str
        Of the predictions.
    protocol, data : Protocol, Path
    read : callable
        Reads the truths, or raises BenchmarkError.
    hold : callable
        Takes a scene's truth and the row of each of its queries, and raises PredictionError.
    suspect : callable
        Takes all truths and returns notes of the track.
    """
    scenes = {scene.id for scene in protocol.scenes}
    if not scenes & set(np.unique(scene_of(ids))):
        return Checked([other_benchmark(path, ids, protocol, data)], [])
    try:
        truths = read()
    except BenchmarkError as error:
        return Checked([], [f"ids were not held against the benchmark: {error.what}"])
    try:
        rows, extra = match_queries(path, ids, protocol, data, truths)
    except PredictionError as error:
        return Checked([error], [])
    faults = []
    for truth, found in zip(truths, rows, strict=True):
        try:
            hold(truth, found)
        except PredictionError as error:
            faults.append(error)
    apart = _counts_apart(protocol, [len(truth.queries) for truth in truths])
    return Checked(faults, [*_assignment_notes(rows, extra), *apart, *suspect(truths)])


def _assignment_notes(rows: Sequence[NDArray[np.intp]], extra: int) -> list[str]:
    """Say how many queries the predictions lack, and how many ids are no queries."""
    missing = sum(int((found < 0).sum()) for found in rows)
    total = sum(len(found) for found in rows)
    notes = []
    if missing:
        notes.append(f"{missing} of {total} queries are missing and will score their worst")
    if extra:
        notes.append(f"{extra} ids are no queries and will be left aside")
    return notes


def make_result(
    run: Run,
    records: pd.DataFrame,
    scores: list[Score],
    counts: dict[str, dict[str, int]],
    extra: int,
    notes: Sequence[str],
    references: Mapping[str, Reference] | None = None,
) -> Result:
    """Average records and put everything that is known of a run into a result.

    Parameters
    ----------
    run : Run
    records : DataFrame
    scores : list of Score
    counts : dict of str to dict of str to int
        By scene.
    extra : int
        Ids of the predictions that are no queries.
    notes : sequence of str
        Of the track, after those that all tracks have.
    references : mapping of str to Reference, optional
        What scores without a method, by the name that tables print.
    """
    protocol = run.protocol
    return Result(
        track=protocol.track,
        protocol=ProtocolUsed(
            name=protocol.name,
            version=protocol.version,
            fingerprint=protocol.fingerprint,
            settings=protocol.settings(),
        ),
        truth=TruthUsed(
            benchmark=run.benchmark.name,
            version=run.benchmark.file.version,
            fingerprint=fingerprint(run.truths),
            scene_titles={scene.id: scene.title for scene in protocol.scenes},
        ),
        predictions=PredictionsUsed(
            file=run.path.name, sha256=sha256_of_tree(run.path), kind=run.kind, method=run.method
        ),
        versions=versions(),
        columns=score_columns(scores),
        counts=counts,
        extra_queries=extra,
        notes=(*common_notes(protocol, counts, extra), *notes),
        **with_summary(summarise(records, scores, [scene.id for scene in protocol.scenes])),
        references=dict(references or {}),
    ).sealed()


def common_notes(protocol: Protocol, counts: dict[str, dict[str, int]], extra: int) -> list[str]:
    """Say what a reader of the numbers of any track must know."""
    missing = sum(scene["missing"] for scene in counts.values())
    notes = []
    by_scene = protocol.track == "reconstruction"
    if missing and not by_scene:
        notes.append(f"{missing} queries are missing from the predictions and score their worst")
    if extra and not by_scene:
        notes.append(f"{extra} ids of the predictions are no queries and were left aside")
    queries = [counts[scene.id]["queries"] for scene in protocol.scenes]
    return [*notes, *([] if by_scene else _counts_apart(protocol, queries))]


def _counts_apart(protocol: Protocol, queries: Sequence[int]) -> list[str]:
    """Say where a scene has not as many queries as in the paper."""
    return [
        f"scene {scene.title} has {found} queries here, {scene.queries} in the paper"
        for scene, found in zip(protocol.scenes, queries, strict=True)
        if scene.queries not in (None, found)
    ]


def other_benchmark(
    path: Path,
    ids: NDArray[np.str_],
    protocol: Protocol,
    data: Path,
    example: str | None = None,
) -> PredictionError:
    """Make the fault of predictions none of whose ids belongs to the benchmark."""
    scenes = set(np.unique(scene_of(ids)))
    ending = scenes <= {scene.id for scene in protocol.scenes} and with_endings(ids)
    alike = [] if ending else _alike(scenes, protocol, data)
    guess = f"they look like those of {' or '.join(alike)}" if alike else ""
    expected = example or ", ".join(f"{scene.id}/..." for scene in protocol.scenes[:3])
    return PredictionError(
        f"none of its query ids belongs to {protocol.benchmark}: {first_of(ids, len(ids))}"
        + (f"; {guess}" if guess else ""),
        where=f"{path}, field 'query_ids'",
        expected=f"ids such as {expected}",
        mend="leave out the file's ending: ids are names without it"
        if ending
        else "name the right protocol with --protocol; `airzoo-bench template` writes the ids",
    )


def _alike(scenes: set[str], protocol: Protocol, data: Path) -> list[str]:
    """Name the protocols of the same track and another benchmark that have one of the scenes."""
    return [
        name
        for name, path in protocol_files(data).items()
        if scenes & _scenes_beside(path, protocol)
    ]


def _scenes_beside(path: Path, protocol: Protocol) -> set[str]:
    try:
        other = load_protocol(path)
    except ProtocolError:  # another benchmark's fault is not this file's
        return set()
    if other.track != protocol.track or other.benchmark == protocol.benchmark:
        return set()
    return {scene.id for scene in other.scenes}
