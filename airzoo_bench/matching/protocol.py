"""Protocols of the matching track."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from airzoo_bench.core.validation import Count, Positive, Seed, Strict, Thresholds
from airzoo_bench.protocol.model import Protocol

SolverName = Literal["colmap", "colmap+refine", "poselib"]
Share = Annotated[float, Field(gt=0, lt=1)]


class Crop(Strict):
    """The part of the map that a query is matched to."""

    margin: Annotated[float, Field(ge=0, le=10)]
    max_range_m: Positive
    missing_heights: Literal["nearest"]
    nearest_of_px: Annotated[int, Field(ge=1, le=1 << 24)]


class Prior(Strict):
    """Where the prior comes from; "given": each photo has a map of its own, which is its crop."""

    source: Literal["metadata", "truth", "given"]

    @property
    def is_measured(self) -> bool:
        """Whether photos say of themselves where they are."""
        return self.source == "metadata"


class Lift(Strict):
    """How pixels of the map become points."""

    map_pixel_centres: Literal["half", "integer"]
    heights_above_m: Annotated[float, Field(allow_inf_nan=False)] | Literal["any"]


class Solver(Strict):
    """How matches become a pose."""

    name: SolverName
    max_error_px: Positive
    min_inlier_ratio: Share
    min_trials: Count
    max_trials: Count
    confidence: Share
    seed: Seed
    least_matches: Annotated[int, Field(ge=4, le=1000)]
    max_matches: Annotated[int, Field(ge=4, le=1_000_000)]
    max_trials_times_matches: Annotated[int, Field(ge=1, le=10**12)]


class MatchingScores(Strict):
    """Thresholds of the scores, all strict."""

    orientation_is_trusted: bool
    failed_rotation_deg: Annotated[float, Field(gt=0, le=180)] | Literal["infinite"]
    translation_below_m: Thresholds
    pose_below_m_deg: Annotated[
        tuple[tuple[Positive, Positive], ...], Field(min_length=1, max_length=16)
    ]
    auc_up_to_m: Thresholds


class MatchingProtocol(Protocol):
    """A protocol of cross-view matching."""

    truth_sections: ClassVar[tuple[str, ...]] = ("crop", "prior")

    track: Literal["matching"]
    crop: Crop | None = None
    prior: Prior
    lift: Lift
    solver: Solver
    scores: MatchingScores

    @model_validator(mode="after")
    def _sections_fit(self) -> MatchingProtocol:
        if (self.crop is None) != (self.prior.source == "given"):
            raise ValueError("a section [crop] is needed, unless prior.source is 'given'")
        if self.solver.max_trials < self.solver.min_trials:
            raise ValueError("solver.max_trials is below solver.min_trials")
        return self
