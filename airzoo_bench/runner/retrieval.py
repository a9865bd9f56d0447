"""The retrieval track: from a prediction file to records and a result."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.benchmark import Benchmark, find_benchmark
from airzoo_bench.progress import Progress, silent
from airzoo_bench.protocol import RetrievalProtocol
from airzoo_bench.readers.retrieval import read_retrieval
from airzoo_bench.retrieval.claims import check_tiles, rank_scene
from airzoo_bench.retrieval.predictions import deep_faults, faults
from airzoo_bench.retrieval.scores import retrieval_scores
from airzoo_bench.retrieval.track import score_scene
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth
from airzoo_bench.runner.common import (
    Checked,
    Evaluation,
    Run,
    check_against_benchmark,
    choose_protocol,
    concatenate,
    make_result,
    match_queries,
    refuse_other_track,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["check_retrieval", "evaluate_retrieval", "read_truths"]


def evaluate_retrieval(
    path: Path,
    *,
    data: Path,
    protocol: str | None = None,
    method: str | None = None,
    memory_bytes: int,
    jobs: int = 1,
    progress: Progress = silent,
) -> Evaluation:
    """Score a prediction file of the retrieval track.

    Parameters
    ----------
    path : Path
        The predictions.
    data : Path
        The benchmark folder, or the folder that holds it.
    protocol : str, optional
        Name or path; by default the file's own.
    method : str, optional
        What tables call it; by default the file's stem.
    memory_bytes : int
        The most that one array of the file, and the ranking of descriptors, may take.
    jobs : int
        Threads for ranking descriptors; the numbers do not depend on it.
    progress : Progress
        Shows scenes as they are done.

    Raises
    ------
    UserError
        The predictions, the protocol or the benchmark folder are not as they must be.
    """
    refuse_other_track(path, protocol, data, RetrievalProtocol, memory_bytes)
    predictions = read_retrieval(path, memory_bytes)
    chosen = choose_protocol(path, predictions.protocol, protocol, data, RetrievalProtocol)
    for fault in faults(predictions, chosen.scores.depth):
        raise fault
    benchmark = find_benchmark(chosen.benchmark, data)
    truths = read_truths(benchmark, chosen)
    rows, extra = match_queries(path, predictions.query_ids, chosen, data, truths)
    parts = []
    for truth, found in progress(zip(truths, rows, strict=True), "scenes", len(truths)):
        ranking = rank_scene(
            predictions, truth, found, chosen.scores, memory_bytes=memory_bytes, workers=jobs
        )
        parts.append(score_scene(truth, ranking, found >= 0, chosen.scores))
    records = concatenate(parts)
    run = Run(
        path,
        method or path.stem,
        predictions.kind,
        chosen,
        benchmark,
        {truth.scene: truth.fingerprint for truth in truths},
    )
    counts = {truth.scene: _counts(truth, records) for truth in truths}
    scores = retrieval_scores(chosen.scores)
    return Evaluation(make_result(run, records, scores, counts, extra, _notes(counts)), records)


def check_retrieval(path: Path, *, data: Path, protocol: str | None, memory_bytes: int) -> Checked:
    """Find all that is wrong with a prediction file, without looking at which tile is positive.

    Where the benchmark folder is there, ids are held against its queries and tiles.

    Raises
    ------
    UserError
        The file cannot be read at all, or the protocol is unknown.
    """
    predictions = read_retrieval(path, memory_bytes)
    chosen = choose_protocol(path, predictions.protocol, protocol, data, RetrievalProtocol)
    found = [*faults(predictions, chosen.scores.depth), *deep_faults(predictions)]
    if found:
        return Checked(found, [])
    return check_against_benchmark(
        path,
        predictions.query_ids,
        chosen,
        data,
        lambda: read_truths(find_benchmark(chosen.benchmark, data), chosen),
        lambda truth, rows: check_tiles(predictions, truth, rows),
    )


def read_truths(benchmark: Benchmark, protocol: RetrievalProtocol) -> list[RetrievalTruth]:
    """Read the truth of every scene of a protocol, in its order."""
    benchmark.check_fits(protocol)
    return [read_truth(benchmark.scene_folder(scene.id), scene.id) for scene in protocol.scenes]


def _counts(truth: RetrievalTruth, records: pd.DataFrame) -> dict[str, int]:
    rows = records[records["scene"] == truth.scene]
    return {
        "queries": len(rows),
        "tiles": len(truth.tiles),
        "missing": int((~rows["answered"]).sum()),
        "tie_dependent": int(rows["tie_dependent"].sum()),
        "without_positive": len(truth.excluded) + int((rows["positives"] == 0).sum()),
        "without_ground_point": truth.without_ground_point,
    }


def _notes(counts: dict[str, dict[str, int]]) -> list[str]:
    tied = sum(scene["tie_dependent"] for scene in counts.values())
    text = f"{tied} queries depend on ties, which were broken against the method"
    return [text] if tied else []
