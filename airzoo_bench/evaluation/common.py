"""What all tracks share on the way from files to a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar
from typing import Protocol as Structural

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError, PredictionError, ProtocolError
from airzoo_bench.core.files import fingerprint, sha256_of_tree
from airzoo_bench.core.ids import Assignment, assign_queries, scene_of
from airzoo_bench.protocol.choice import other_benchmark
from airzoo_bench.protocol.lookup import Protocol, load_protocol, protocol_files
from airzoo_bench.results.comparable import other_settings
from airzoo_bench.results.result import (
    PredictionsUsed,
    ProtocolUsed,
    Reference,
    Result,
    TruthUsed,
    score_columns,
    versions,
    with_summary,
)
from airzoo_bench.results.scores import Score, summarise

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Checked",
    "Run",
    "check_against_benchmark",
    "concatenate",
    "make_result",
    "match_queries",
    "namesake_notes",
]

P = TypeVar("P", bound=Protocol)


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
) -> Assignment:
    """Find the row of the predictions that answers each query; see `ids.assign_queries`.

    Raises
    ------
    PredictionError
        No id is a query; the message says which benchmark they look like.
    """
    assigned = assign_queries(ids, [truth.queries["id"] for truth in truths])
    if all((found < 0).all() for found in assigned.rows):
        example = str(truths[0].queries["id"].iloc[0])
        raise other_benchmark(path, ids, protocol, data, example)
    return assigned


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
        Takes all truths and returns notes of the track; asked where nothing is wrong.
    """
    scenes = {scene.id for scene in protocol.scenes}
    if not scenes & set(np.unique(scene_of(ids))):
        return Checked([other_benchmark(path, ids, protocol, data)], [])
    try:
        truths = read()
    except BenchmarkError as error:
        return Checked([], [f"ids were not held against the benchmark: {error.what}"])
    try:
        assigned = match_queries(path, ids, protocol, data, truths)
    except PredictionError as error:
        return Checked([error], [])
    faults = []
    for truth, found in zip(truths, assigned.rows, strict=True):
        try:
            hold(truth, found)
        except PredictionError as error:
            faults.append(error)
    counts = [{"queries": len(truth.queries)} for truth in truths]
    apart = _counts_apart(protocol, dict(zip((s.id for s in protocol.scenes), counts, strict=True)))
    notes = [*namesake_notes(protocol, data), *assigned.notes(), *apart]
    return Checked(faults, [*notes, *(suspect(truths) if not faults else [])])


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
        Ids of the predictions that are no queries, or no scenes.
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
        notes=(
            *namesake_notes(protocol, run.benchmark.folder),
            *_counts_apart(protocol, counts),
            *notes,
        ),
        **with_summary(summarise(records, scores, [scene.id for scene in protocol.scenes])),
        references=dict(references or {}),
    ).sealed()


def namesake_notes(used: Protocol, data: Path) -> list[str]:
    """Say so where a protocol goes by the name of another one, which readers would take it for."""
    path = protocol_files(data).get(used.name)
    try:
        known = None if path is None else load_protocol(path)
    except ProtocolError:  # what nobody can use is no namesake
        known = None
    if known is None or known.fingerprint == used.fingerprint:
        return []
    why = other_settings(known.settings(), used.settings())
    return [f"the protocol is not the {used.name} that all have: {why}"]


def _counts_apart(protocol: Protocol, counts: dict[str, dict[str, int]]) -> list[str]:
    """Say where a scene has not as many queries as in the paper."""
    if protocol.track == "reconstruction":  # whose scenes are what is asked
        return []
    return [
        f"scene {scene.title} has {counts[scene.id]['queries']:,} queries here, "
        f"{scene.queries:,} in the paper"
        for scene in protocol.scenes
        if scene.queries not in (None, counts[scene.id]["queries"])
    ]
