"""Scoring predictions of any track: from a file to records and a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import ProtocolError
from airzoo_bench.core.files import fingerprint, sha256_of, sha256_of_tree
from airzoo_bench.core.version import versions
from airzoo_bench.evaluation.given import Given, ReadBy, read_truths
from airzoo_bench.evaluation.scene_store import SceneStore
from airzoo_bench.evaluation.track import Run, Scored, Truth
from airzoo_bench.evaluation.truth_accuracy import accuracy_notes
from airzoo_bench.evaluation.untrusted import open_as_trusted
from airzoo_bench.protocol.lookup import load_protocol, protocol_files
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.comparable import other_settings
from airzoo_bench.results.result import (
    PredictionsUsed,
    ProtocolUsed,
    Result,
    TruthUsed,
    score_columns,
)
from airzoo_bench.results.scores import Score, concatenate, summarise

__all__ = ["Evaluation", "counts_apart", "evaluate", "namesake_notes", "truth_fingerprint"]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A result, the records it was made from, and the scenes that figures need besides."""

    result: Result
    records: pd.DataFrame
    given: Given
    benchmark: Benchmark
    truths: list[Any]
    scored: dict[str, Scored]

    @property
    def protocol(self) -> Any:
        """The protocol, of its track's own class."""
        return self.given.protocol


def evaluate(
    path: Path,
    *,
    data: Path,
    track: str | None = None,
    protocol: str | None = None,
    method: str | None = None,
    run: Run = Run(),  # noqa: B008 - frozen
    read_by: ReadBy = ReadBy(),  # noqa: B008 - frozen
    begun: Callable[[], None] = lambda: None,
    store: SceneStore | None = None,
) -> Evaluation:
    """Score predictions; `begun` is called once they are known to be scored."""
    given = open_as_trusted(path, track, protocol, data, run, read_by)
    of, predictions, chosen = given.track, given.predictions, given.protocol
    benchmark, truths = _open_truths(given, data)
    assignment = of.assign(predictions, truths, chosen)
    for error in assignment.errors:
        raise error
    sha256 = sha256_of_tree(path)
    begun()
    kept = None if store is None else _Kept(store, _run_of(given, sha256, truths, read_by, run))
    scored = []
    parts = zip(truths, assignment.parts, strict=True)
    for truth, part in run.progress(parts, "scenes", len(truths)):
        scene = None if kept is None else kept.store.load(kept.run, truth.scene)
        if scene is None:
            scene = of.score(part, truth, chosen, run)
            if kept is not None:
                kept.store.save(kept.run, truth.scene, scene)
        scored.append(scene)
    scores, records = _records(scored, of.scores(chosen))
    by_scene = {truth.scene: scene for truth, scene in zip(truths, scored, strict=True)}
    notes = (
        *given.notes,
        *assignment.notes,
        *(note for scene in scored for note in scene.notes),
        *of.notes(predictions, truths, chosen, scored),
    )
    counts = {name: scene.counts for name, scene in by_scene.items()}
    result = Result(
        track=chosen.track,
        protocol=ProtocolUsed(
            name=chosen.name,
            version=chosen.version,
            fingerprint=chosen.fingerprint,
            settings=chosen.settings(),
        ),
        truth=TruthUsed(
            benchmark=benchmark.name,
            version=benchmark.file.version,
            fingerprint=truth_fingerprint(truths),
            scene_titles={scene.id: scene.title for scene in chosen.scenes},
        ),
        predictions=PredictionsUsed(
            file=path.name,
            sha256=sha256,
            kind=", ".join(sorted({scene.kind for scene in scored if scene.kind is not None})),
            method=method or (path.name if path.is_dir() else path.stem),
            reader=given.reader,
        ),
        versions=dict(versions()),
        columns=score_columns(scores),
        counts=counts,
        extra_queries=assignment.strange,
        notes=(
            *namesake_notes(chosen, benchmark.folder),
            *counts_apart(chosen, counts),
            *accuracy_notes(
                chosen, {scene.id: scene.truth_accuracy_m for scene in benchmark.file.scenes}
            ),
            *notes,
        ),
        **asdict(summarise(records, scores, [scene.id for scene in chosen.scenes])),
        references=dict(of.references(chosen, truths)),
    ).with_checksum()
    return Evaluation(result, records, given, benchmark, truths, by_scene)


@dataclass(frozen=True)
class _Kept:
    store: SceneStore
    run: str


def _open_truths(given: Given, data: Path) -> tuple[Benchmark, list[Any]]:
    """Return the truths that a reader was given, unless they are sealed, else read them."""
    if given.truths is not None and not given.truths[0].is_sealed:
        return given.truths
    return read_truths(given.protocol, data)


def _run_of(given: Given, sha256: str, truths: Sequence[Truth], read_by: ReadBy, run: Run) -> str:
    """Return a fingerprint of all that scores of scenes depend on."""
    return fingerprint(
        {
            "predictions": sha256,
            "reader": None if given.reader is None else given.reader.model_dump(mode="json"),
            "names": None if read_by.names is None else sha256_of(read_by.names),
            "protocol": given.protocol.fingerprint,
            "truth": {truth.scene: truth.fingerprint for truth in truths},
            "versions": versions(),
            "memory": run.memory_bytes,  # how queries and clouds are cut
        }
    )


def _records(scored: Sequence[Scored], scores: list[Score]) -> tuple[list[Score], pd.DataFrame]:
    """Return the scores that any scene has, and all records: the worst where a scene lacks one."""
    records = concatenate([scene.records for scene in scored])
    scores = [score for score in scores if score.column in records]
    lacking = {
        score.column: 0.0 if score.higher_is_better else np.inf
        for score in scores
        if not all(score.column in scene.records for scene in scored)
    }
    return scores, records.fillna(lacking) if lacking else records


def truth_fingerprint(truths: Sequence[Truth]) -> str:
    """Return the SHA-256 over all that scores of some scenes depend on."""
    return fingerprint({truth.scene: truth.fingerprint for truth in truths})


def namesake_notes(used: Protocol, data: Path) -> list[str]:
    """Note a protocol that has the name of a known one and measures something else."""
    path = protocol_files(data).get(used.name)
    try:
        known = None if path is None else load_protocol(path)
    except ProtocolError:  # a protocol that cannot be used is no namesake
        known = None
    if known is None or known.fingerprint == used.fingerprint:
        return []
    why = other_settings(known.settings(), used.settings())
    return [f"the protocol is not the {used.name} that all have: {why}"]


def counts_apart(protocol: Protocol, counts: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Note scenes whose number of queries is not the paper's."""
    return [
        f"scene {scene.title} has {counts[scene.id]['queries']:,} queries here, "
        f"{scene.queries:,} in the paper"
        for scene in protocol.scenes
        if scene.queries not in (None, counts[scene.id].get("queries", scene.queries))
    ]
