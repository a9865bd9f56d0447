"""How far matching's scores depend on the seed of the solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.evaluation.common import concatenate
from airzoo_bench.matching.scores import matching_scores
from airzoo_bench.matching.track import MatchingEvaluation, score_claims
from airzoo_bench.results.scores import Score, summarise

__all__ = ["SeedSpread", "spread_over_seeds"]


@dataclass(frozen=True)
class SeedSpread:
    """One score under several seeds: the average over scenes at its least, median and most.

    Attributes
    ----------
    score : Score
    least, median, most : float
    """

    score: Score
    least: float
    median: float
    most: float

    def __str__(self) -> str:
        scale, unit = (100.0, "%") if self.score.unit == "share" else (1.0, self.score.unit)
        least, median, most = (f"{scale * v:.2f}" for v in (self.least, self.median, self.most))
        return f"{self.score.title}: {least} to {most} {unit}, median {median}"


def spread_over_seeds(
    evaluation: MatchingEvaluation, seeds: int, *, jobs: int, progress: Progress = silent
) -> list[SeedSpread]:
    """Score the same claims with the protocol's seed and the seeds that follow it.

    Parameters
    ----------
    evaluation : MatchingEvaluation
        Made with the protocol's seed, which counts as the first.
    seeds : int
        How many, at least 2.
    jobs : int
    progress : Progress

    Returns
    -------
    list of SeedSpread
        Of the headline scores, averaged over scenes.
    """
    protocol = evaluation.protocol
    scores = [score for score in matching_scores(protocol.scores) if score.headline]
    averages = [evaluation.evaluation.result.overall]
    for step in range(1, seeds):
        solver = protocol.solver.model_copy(update={"seed": protocol.solver.seed + step})
        scored = score_claims(
            protocol.model_copy(update={"solver": solver}),
            evaluation.truths,
            evaluation.claims,
            jobs=jobs,
            progress=progress,
        )
        records = concatenate([scene.records for scene in scored])
        averages.append(summarise(records, scores, [t.scene for t in evaluation.truths]).overall)
    return [_spread(score, [values[score.column] for values in averages]) for score in scores]


def _spread(score: Score, values: list[float]) -> SeedSpread:
    # The lower of the two in the middle, since the mean of infinities and numbers says nothing.
    median = sorted(values)[(len(values) - 1) // 2]
    return SeedSpread(score, float(np.min(values)), median, float(np.max(values)))
