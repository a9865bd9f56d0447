"""The matching track: a UAV photo is matched to an orthophoto and posed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.queries import assign_queries, write_predictions
from airzoo_bench.evaluation.track import Assignment, Run, Scored, Track
from airzoo_bench.matching.checks import check_file, open_scene
from airzoo_bench.matching.info import INFO
from airzoo_bench.matching.metrics import matching_scores
from airzoo_bench.matching.predictions import (
    MatchingPredictions,
    ScenePredictions,
    read_matching,
)
from airzoo_bench.matching.scoring import RECORDED, score_priors, score_scene
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.matching.truth import MatchingTruth, read_truth
from airzoo_bench.results.result import Reference
from airzoo_bench.results.scores import Score, concatenate, summarise

PRIOR_ITSELF = "Prior itself"
"""The reference of every result of the track."""

_MATCHES = 20  # of each query, in a template


class MatchingTrack(Track):
    """Cross-view matching; see `Track`."""

    info = INFO
    protocol = MatchingProtocol
    recorded = RECORDED

    def open(self, path: Path, memory_bytes: int) -> MatchingPredictions:
        """See `Track.open`."""
        return read_matching(path, memory_bytes)

    def truth(self, benchmark: Benchmark, scene: str) -> MatchingTruth:
        """See `Track.truth`."""
        return read_truth(benchmark, scene)

    def assign(
        self,
        predictions: MatchingPredictions,
        truths: Sequence[MatchingTruth],
        protocol: MatchingProtocol,
    ) -> Assignment:
        """See `Track.assign`; errors of all scenes are found before any pose is solved."""
        check_file(predictions, None if truths else protocol.scores.finest_m)
        assignment = assign_queries(predictions, truths, protocol)
        for place, truth in enumerate(truths):
            rows, assignment.parts[place] = assignment.parts[place].rows, None
            try:
                assignment.parts[place] = open_scene(predictions, truth, rows, protocol.scores)
            except PredictionError as error:
                assignment.errors.append(error.inside(predictions.path))
        return assignment

    def score(
        self, part: ScenePredictions, truth: MatchingTruth, protocol: MatchingProtocol, run: Run
    ) -> Scored:
        """See `Track.score`."""
        return score_scene(truth, part, protocol, run)

    def check(
        self,
        part: ScenePredictions,
        truth: MatchingTruth | None,
        protocol: MatchingProtocol,
        run: Run,
    ) -> Scored:
        """See `Track.check`."""
        counts = {} if truth is None else {"queries": len(truth.queries)}
        return Scored(counts=counts, notes=() if truth is None else part.notes)

    def scores(self, protocol: MatchingProtocol) -> list[Score]:
        """See `Track.scores`."""
        return matching_scores(protocol.scores)

    def notes(
        self,
        predictions: MatchingPredictions,
        truths: Sequence[MatchingTruth],
        protocol: MatchingProtocol,
        scored: Sequence[Scored],
    ) -> list[str]:
        """Say what was scored, which no scene says for itself."""
        return [f"scored from {one.kind}" for one in scored[:1] if one.kind]

    def references(
        self, protocol: MatchingProtocol, truths: Sequence[MatchingTruth]
    ) -> dict[str, Reference]:
        """Score the priors as if they were a method's poses; where none are measured, nothing."""
        if not protocol.prior.is_measured:
            return {}
        records = concatenate([score_priors(truth, protocol.scores) for truth in truths])
        scenes = [truth.scene for truth in truths]
        summary = summarise(records, matching_scores(protocol.scores), scenes)
        meaning = "what the photos' own GPS and gimbal angles score, without any matching"
        return {PRIOR_ITSELF: Reference(meaning=meaning, **asdict(summary))}

    def template(
        self,
        out: Path,
        truths: Sequence[MatchingTruth],
        protocol: MatchingProtocol,
        kind: str,
        seed: int,
    ) -> str | None:
        """Match random pixels of every query to random pixels of its crop."""
        random = np.random.default_rng(seed)
        sizes = [np.stack([t.cameras.width, t.cameras.height], axis=1) for t in truths]
        size = np.repeat(np.concatenate(sizes), _MATCHES, axis=0)
        crop = np.repeat(np.concatenate([t.crops for t in truths]), _MATCHES, axis=0)
        ids = np.concatenate([t.queries["id"].to_numpy(str) for t in truths])
        arrays = {
            "query_ids": ids,
            "offsets": np.arange(len(ids) + 1) * _MATCHES,
            "query_xy": random.uniform(0, size),
            "map_xy": crop[:, :2] + random.uniform(0, crop[:, 2:]),
        }
        write_predictions(out, protocol.name, arrays)
        return None


def write_timings(evaluation: Evaluation, path: Path) -> None:
    """Write seconds of the solver for each query, which differ by run."""
    parts = [
        scene.records[["scene", "query"]].assign(seconds=scene.facts["seconds"])
        for scene in evaluation.scored.values()
    ]
    with atomic_write(path, "w") as stream:
        concatenate(parts).to_csv(stream, index=False, lineterminator="\n")


TRACK = MatchingTrack()
