"""What a protocol of the matching track states."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from airzoo_bench.settings import Limits, Positive, Strict

__all__ = ["Crop", "MatchingScores", "Prior", "Solver"]


def _ascending_pairs(pairs: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    if list(pairs) != sorted(set(pairs)):
        raise ValueError("must be ascending pairs (metres, degrees), without repeats")
    return pairs


class Crop(Strict):
    """The part of the map that a query is matched to."""

    margin: Annotated[float, Field(ge=0, le=10)]
    max_range_m: Positive
    missing_heights: Literal["nearest", "plane", "cut"]
    nearest_of_px: Annotated[int, Field(ge=1, le=1 << 24)]


class Prior(Strict):
    """Where the crop comes from; never the truth, unless a protocol says so by name."""

    source: Literal["metadata", "truth"]


class Solver(Strict):
    """How matches become a pose."""

    name: Literal["colmap", "colmap+refine", "poselib"]
    max_error_px: Positive
    min_inlier_ratio: Annotated[float, Field(gt=0, lt=1)]
    min_trials: Annotated[int, Field(ge=1)]
    max_trials: Annotated[int, Field(ge=1)]
    confidence: Annotated[float, Field(gt=0, lt=1)]
    seed: Annotated[int, Field(ge=0, lt=2**31)]


class MatchingScores(Strict):
    """Thresholds of the scores, all strict."""

    orientation_is_trusted: bool
    translation_below_m: Limits
    pose_below_m_deg: Annotated[
        tuple[tuple[Positive, Positive], ...],
        Field(min_length=1, max_length=16),
        AfterValidator(_ascending_pairs),
    ]
    auc_up_to_m: Limits
