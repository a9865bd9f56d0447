"""The matching track: a UAV photo is matched to an orthophoto and posed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.parts import EvalOption
from airzoo_bench.evaluation.query_track import QueryTrack
from airzoo_bench.evaluation.resources import Resources
from airzoo_bench.matching.baseline_run import SIFT
from airzoo_bench.matching.claims import SceneClaim, claim_of_scene
from airzoo_bench.matching.notes import claim_notes, equal_to_prior, lifting_notes, scored_notes
from airzoo_bench.matching.predictions import (
    MatchingPredictions,
    PoseClaim,
    check_digits,
    validation_errors,
)
from airzoo_bench.matching.reading import read_matching
from airzoo_bench.matching.scores import matching_scores
from airzoo_bench.matching.scoring import ScoredScene, score_priors, score_scene
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.matching.template import match_template
from airzoo_bench.matching.truth import MatchingTruth, read_truth
from airzoo_bench.results.result import Reference, with_summary
from airzoo_bench.results.scores import Score, concatenate, summarise

__all__ = ["PRIOR_ITSELF", "TRACK", "MatchingTrack"]

PRIOR_ITSELF = "Prior itself"
"""The reference of every result of the track."""

_MATCHES = 20


def _write_timings(evaluation: Evaluation, path: Path) -> None:
    """Write seconds of the solver for each query, which differ by run."""
    parts = [
        scene.records[["scene", "query"]].assign(seconds=np.round(scene.seconds, 6))
        for scene in evaluation.scored.values()
    ]
    with atomic_write(path, "w") as stream:
        concatenate(parts).to_csv(stream, index=False, lineterminator="\n")


class MatchingTrack(
    QueryTrack[MatchingProtocol, MatchingPredictions, MatchingTruth, SceneClaim, ScoredScene]
):
    """Cross-view matching; see `Track`."""

    name = "matching"
    summary = (
        "Score cross-view matching: translation and pose recall, median error, for each scene."
    )
    protocol = MatchingProtocol
    kinds = ".npz or .txt"
    suffixes = (".npz", ".txt")
    argument = "An .npz of matches, 2D-3D pairs or poses, or a .txt of poses."
    example = "matches.npz --out results/mymethod --figures"
    options = (
        EvalOption(
            "figures",
            "Draw error curves, matches and maps into --out.",
            "airzoo_bench.report.matching:draw_figures",
        ),
        EvalOption(
            "seeds",
            "Solve under so many seeds and say how far the scores spread.",
            "airzoo_bench.matching.seeds:spread_over_seeds",
            default=1,
            most=1000,
            needs_out=False,
        ),
    )
    files = {"timings.csv": _write_timings}  # noqa: RUF012 - never changed
    baseline = SIFT

    def read(self, path: Path, memory_bytes: int) -> MatchingPredictions:
        """See `read_matching`."""
        return read_matching(path, memory_bytes)

    def validation_errors(
        self, predictions: MatchingPredictions, protocol: MatchingProtocol, *, thorough: bool
    ) -> Iterator[PredictionError]:
        """See `predictions.validation_errors`."""
        yield from validation_errors(predictions)

    def read_truth(self, benchmark: Benchmark, scene: str) -> MatchingTruth:
        """See `truth.read_truth`."""
        return read_truth(benchmark, scene)

    def claim(
        self,
        predictions: MatchingPredictions,
        truth: MatchingTruth,
        rows: NDArray[np.intp],
        protocol: MatchingProtocol,
        resources: Resources,
    ) -> SceneClaim:
        """See `claim_of_scene`."""
        return claim_of_scene(predictions, truth, rows)

    def score(
        self,
        claim: SceneClaim,
        truth: MatchingTruth,
        protocol: MatchingProtocol,
        resources: Resources,
    ) -> ScoredScene:
        """See `score_scene`."""
        scored = score_scene(
            truth,
            claim,
            protocol.lift,
            protocol.solver,
            protocol.scores,
            workers=resources.jobs,
            progress=resources.progress,
        )
        same = {"equal_to_prior": equal_to_prior(truth, claim)}
        return replace(scored, counts=scored.counts | same)

    def scores(self, protocol: MatchingProtocol, scored: Sequence[ScoredScene]) -> list[Score]:
        """See `matching_scores`."""
        return matching_scores(protocol.scores)

    def notes(
        self,
        predictions: MatchingPredictions,
        protocol: MatchingProtocol,
        truths: Sequence[MatchingTruth],
        claims: Sequence[SceneClaim],
        scored: Sequence[ScoredScene],
    ) -> list[str]:
        """See `scored_notes` and `claim_notes`."""
        return [
            *scored_notes(self.records(scored, protocol), predictions, truths, scored),
            *claim_notes(truths, claims),
        ]

    def inspect_alone(
        self, predictions: MatchingPredictions, protocol: MatchingProtocol, resources: Resources
    ) -> Iterator[PredictionError | str]:
        """See `check_digits`, which claims do where there are queries to make them for."""
        if isinstance(predictions.claim, PoseClaim):
            try:
                check_digits(predictions.claim, predictions.query_ids)
            except PredictionError as error:
                yield error.inside(predictions.path)

    def check_notes(
        self,
        predictions: MatchingPredictions,
        protocol: MatchingProtocol,
        truths: Sequence[MatchingTruth],
        claims: Sequence[SceneClaim],
        resources: Resources,
    ) -> list[str]:
        """See `lifting_notes` and `claim_notes`."""
        return [
            *lifting_notes(truths, claims, protocol.lift, protocol.solver, resources.jobs),
            *claim_notes(truths, claims),
        ]

    def references(
        self, protocol: MatchingProtocol, truths: Sequence[MatchingTruth]
    ) -> dict[str, Reference]:
        """Score the priors as if they were a method's poses; where they are the truth, nothing."""
        if protocol.prior.source == "truth":
            return {}
        records = concatenate([score_priors(truth, protocol.scores) for truth in truths])
        scores, scenes = matching_scores(protocol.scores), [truth.scene for truth in truths]
        floor = Reference(
            meaning="what the photos' own GPS and gimbal angles score, without any matching",
            **with_summary(summarise(records, scores, scenes)),
        )
        return {PRIOR_ITSELF: floor}

    def template(
        self,
        protocol: MatchingProtocol,
        truths: Sequence[MatchingTruth],
        kind: str,
        seed: int,
    ) -> dict[str, NDArray[Any]]:
        """See `match_template`."""
        return match_template(truths, _MATCHES, seed)


TRACK = MatchingTrack()
