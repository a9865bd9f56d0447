"""The retrieval track: from a prediction file to records and a result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.errors import counted, first_of
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.evaluation.common import (
    Checked,
    Run,
    check_against_benchmark,
    concatenate,
    make_result,
    match_queries,
)
from airzoo_bench.evaluation.run_files import Evaluation
from airzoo_bench.protocol.choice import choose_protocol, refuse_other_track
from airzoo_bench.protocol.lookup import RetrievalProtocol
from airzoo_bench.results.result import Reference, with_summary
from airzoo_bench.results.scores import summarise
from airzoo_bench.retrieval.chance import chance_scores
from airzoo_bench.retrieval.claims import is_answered, rank_scene, strange_tiles
from airzoo_bench.retrieval.hits import hit_matrix
from airzoo_bench.retrieval.predictions import RetrievalPredictions, deep_faults, faults
from airzoo_bench.retrieval.reading import read_retrieval
from airzoo_bench.retrieval.scores import retrieval_scores
from airzoo_bench.retrieval.scoring import score_scene
from airzoo_bench.retrieval.settings import RetrievalScores
from airzoo_bench.retrieval.ties import Ranking
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth

__all__ = ["chance_level", "chance_words", "check_retrieval", "evaluate_retrieval", "read_truths"]

_SHOWN_LETTERS = 80


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
    assigned = match_queries(path, predictions.query_ids, chosen, data, truths)
    scenes = [
        _ranked(predictions, truth, found, chosen, memory_bytes, jobs)
        for truth, found in progress(zip(truths, assigned.rows, strict=True), "scenes", len(truths))
    ]
    records = concatenate(
        [score_scene(one.truth, one.ranking, one.answered, chosen.scores) for one in scenes]
    )
    run = Run(
        path,
        method or path.stem,
        predictions.kind,
        chosen,
        benchmark,
        {truth.scene: truth.fingerprint for truth in truths},
    )
    counts = {one.truth.scene: _counts(one) for one in scenes}
    scores, extra = retrieval_scores(chosen.scores), len(assigned.strange)
    notes = [*assigned.notes(), *_notes(predictions, scenes, chosen)]
    references = {"Chance level": chance_level(truths, chosen)}
    return Evaluation(make_result(run, records, scores, counts, extra, notes, references), records)


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
    metric, scenes_known = chosen.scores.descriptor_metric, [scene.id for scene in chosen.scenes]
    found = [
        *faults(predictions, chosen.scores.depth),
        *deep_faults(predictions, metric, scenes_known),
    ]
    if found:
        return Checked(found, [])
    scenes: list[_Scene] = []

    def hold(truth: RetrievalTruth, rows: NDArray[np.intp]) -> None:
        scenes.append(_ranked(predictions, truth, rows, chosen, memory_bytes, 1))

    return check_against_benchmark(
        path,
        predictions.query_ids,
        chosen,
        data,
        lambda: read_truths(find_benchmark(chosen.benchmark, data), chosen),
        hold,
        lambda _: _notes(predictions, scenes, chosen),
    )


def read_truths(benchmark: Benchmark, protocol: RetrievalProtocol) -> list[RetrievalTruth]:
    """Read the truth of every scene of a protocol, in its order."""
    benchmark.check_fits(protocol)
    return [read_truth(benchmark.scene_folder(scene.id), scene.id) for scene in protocol.scenes]


def chance_level(truths: Sequence[RetrievalTruth], protocol: RetrievalProtocol) -> Reference:
    """Return what tiles in random order score, by scene; see `chance_scores`."""
    import pandas as pd

    tables = [
        pd.DataFrame(
            chance_scores(truth.positives.counts, len(truth.tiles), protocol.scores)
        ).assign(scene=truth.scene)
        for truth in truths
    ]
    scores = [score for score in retrieval_scores(protocol.scores) if score.column in tables[0]]
    summary = summarise(concatenate(tables), scores, [truth.scene for truth in truths])
    return Reference(
        meaning="expected of tiles in random order, exactly, from each query's number of positives "
        "and the size of its gallery",
        **with_summary(summary),
    )


def chance_words(protocol: RetrievalProtocol, data: Path) -> str:
    """Write out the chance level of the headline scores, averaged over scenes."""
    truths = read_truths(find_benchmark(protocol.benchmark, data), protocol)
    level = chance_level(truths, protocol).overall
    headline = [score for score in retrieval_scores(protocol.scores) if score.headline]
    return ", ".join(f"{score.title} {level[score.column]:.2%}" for score in headline)


@dataclass(frozen=True)
class _Scene:
    """What became of one scene: its truth, its ranking, and which lists there are."""

    truth: RetrievalTruth
    ranking: Ranking
    answered: NDArray[np.bool_]
    given: NDArray[np.bool_]

    @property
    def lengths(self) -> NDArray[np.int64]:
        """How many ranks each query has a tile at."""
        lengths: NDArray[np.int64] = np.count_nonzero(self.ranking.tiles >= 0, axis=1)
        return lengths

    def shorter(self, depth: int) -> int:
        """Count the lists that end before a rank, and not all of whose positives they hold."""
        positives = self.truth.positives
        hits = hit_matrix(
            self.ranking.tiles, positives.offsets, positives.tiles, len(self.truth.tiles)
        )
        short = (self.lengths > 0) & (self.lengths < min(depth, len(self.truth.tiles)))
        return int((short & (np.count_nonzero(hits, axis=1) < positives.counts)).sum())


def _ranked(
    predictions: RetrievalPredictions,
    truth: RetrievalTruth,
    rows: NDArray[np.intp],
    protocol: RetrievalProtocol,
    memory_bytes: int,
    jobs: int,
) -> _Scene:
    ranking = rank_scene(
        predictions, truth, rows, protocol.scores, memory_bytes=memory_bytes, workers=jobs
    )
    return _Scene(truth, ranking, is_answered(predictions, rows), rows >= 0)


def _counts(scene: _Scene) -> dict[str, int]:
    truth = scene.truth
    return {
        "queries": len(truth.queries),
        "tiles": len(truth.tiles),
        "missing": int((~scene.answered).sum()),
        "empty_lists": int((scene.given & ~scene.answered).sum()),
        "tie_dependent": int(scene.ranking.tie_dependent.sum()),
        "without_positive": len(truth.excluded) + int((truth.positives.counts == 0).sum()),
        "without_ground_point": truth.without_ground_point,
        "dropped_tiles": len(truth.dropped_tiles),
    }


def _notes(
    predictions: RetrievalPredictions, scenes: Sequence[_Scene], protocol: RetrievalProtocol
) -> list[str]:
    """Say what `eval` and `check` find beside the scores."""
    counts = [_counts(scene) for scene in scenes]
    empty = sum(count["empty_lists"] for count in counts)
    tied = sum(count["tie_dependent"] for count in counts)
    flat = sum(int((scene.answered & (scene.lengths == 0)).sum()) for scene in scenes)
    dropped = sum(count["dropped_tiles"] for count in counts)
    said = (
        (empty, "query has", "queries have", "an empty list, scored as if it were missing"),
        (tied, "query depends", "queries depend", "on ties, which were broken against the method"),
        (flat, "query gives", "queries give", "all tiles the same score: no ranking, no hit"),
        (dropped, "tile is", "tiles are", "in no gallery, since the map is empty there"),
    )
    return [
        *(f"{counted(n, one, many)} {what}" for n, one, many, what in said if n),
        *_strange_tiles(predictions, [scene.truth for scene in scenes]),
        *_short_lists(scenes, protocol.scores),
    ]


def _strange_tiles(
    predictions: RetrievalPredictions, truths: Sequence[RetrievalTruth]
) -> list[str]:
    strange = strange_tiles(predictions, truths)
    # Cut, since ids of a file may be long, and notes stand under tables.
    named = first_of(name[:_SHOWN_LETTERS] for name in strange.tolist())
    return [f"described tiles that are in no gallery, left aside: {named}"] if strange.size else []


def _short_lists(scenes: Sequence[_Scene], scores: RetrievalScores) -> list[str]:
    """Say which scores read ranks that lists do not have; those of the paper do not."""
    n = sum(scene.shorter(scores.ranks_kept) for scene in scenes)
    if not n:
        return []
    depths = [k for k in scores.ndcg_at if any(scene.shorter(k) for scene in scenes)]
    names = _and(["mAP", "MRR", *(f"nDCG@{k}" for k in depths)])
    read = _and([score.title for score in retrieval_scores(scores) if score.headline])
    return [
        f"{counted(n, 'list ends', 'lists end')} before rank {scores.ranks_kept} without all "
        f"positives: to {names} the others are not found; {read} do not look that far"
    ]


def _and(names: Sequence[str]) -> str:
    return ", ".join(names[:-1]) + f" and {names[-1]}"
