"""How far matching's scores depend on the seed of the solver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from airzoo_bench.core.progress import silent
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.matching.scores import matching_scores
from airzoo_bench.results.scores import Score, summarise

__all__ = ["SeedSpread", "seed_spreads", "spread_over_seeds"]


@dataclass(frozen=True)
class SeedSpread:
    """One score under several seeds: the average over scenes at its least, median and most."""

    score: Score
    least: float
    median: float
    most: float

    def __str__(self) -> str:
        scale, unit = (100.0, "%") if self.score.unit == "share" else (1.0, self.score.unit)
        least, median, most = (f"{scale * v:.2f}" for v in (self.least, self.median, self.most))
        return f"{self.score.title}: {least} to {most} {unit}, median {median}"


def spread_over_seeds(
    evaluation: Evaluation, seeds: int, out: Path | None, resources: Resources
) -> Iterator[str]:
    """Score the same predictions with the protocol's seed and the seeds that follow it.

    Parameters
    ----------
    evaluation : Evaluation
        Made with the protocol's seed, which counts as the first.
    seeds : int
    out : Path or None
        Not written to.
    resources : Resources

    Yields
    ------
    str
        A heading, and a line for each headline score, averaged over scenes.
    """
    yield f"average over scenes under {seeds} seeds, of which the result has the first:"
    for one in seed_spreads(evaluation, seeds, resources):
        yield f"  {one}"


def seed_spreads(evaluation: Evaluation, seeds: int, resources: Resources) -> list[SeedSpread]:
    """Return how far each headline score, averaged over scenes, spreads over seeds."""
    protocol, track = evaluation.protocol, evaluation.given.track
    scores = [score for score in matching_scores(protocol.scores) if score.headline]
    averages = [evaluation.result.overall]
    pairs = list(zip(evaluation.scene_predictions, evaluation.truths, strict=True))
    quietly = replace(resources, progress=silent)  # the seeds are shown, not what each consists of
    for step in resources.progress(range(1, seeds), "further seeds", seeds - 1):
        solver = protocol.solver.model_copy(update={"seed": protocol.solver.seed + step})
        seeded = protocol.model_copy(update={"solver": solver})
        scored = [track.score(predicted, truth, seeded, quietly) for predicted, truth in pairs]
        scenes = [truth.scene for _, truth in pairs]
        averages.append(summarise(track.records(scored, seeded), scores, scenes).overall)
    return [_spread(score, [values[score.column] for values in averages]) for score in scores]


def _spread(score: Score, values: list[float]) -> SeedSpread:
    # The lower of the two in the middle, since the mean of a number and infinity is no median.
    median = sorted(values)[(len(values) - 1) // 2]
    return SeedSpread(score, float(np.min(values)), median, float(np.max(values)))
