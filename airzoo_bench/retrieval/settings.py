"""What a protocol of the retrieval track states."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from airzoo_bench.core.validation import Limits, Positive, Ranks, Strict
from airzoo_bench.protocol.model import Protocol

__all__ = [
    "ApVariant",
    "Gallery",
    "GroundTruth",
    "RetrievalProtocol",
    "RetrievalScores",
]

ApVariant = Literal["precision", "min", "trec", "hits"]


class Gallery(Strict):
    """How the georeferenced map is cut into tiles."""

    tile_sizes_px: Annotated[
        tuple[Annotated[int, Field(ge=16, le=8192)], ...], Field(min_length=1, max_length=8)
    ]
    overlap: Annotated[float, Field(ge=0, lt=1)]
    gsd_m: Positive | Literal["any"]
    gsd_tolerance: Annotated[float, Field(gt=0, lt=1)]
    least_valid_share: Annotated[float, Field(ge=0, le=1)] | Literal["none"]

    @field_validator("tile_sizes_px")
    @classmethod
    def _sizes_differ(cls, sizes: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(sizes)) != len(sizes):
            raise ValueError("each tile size once")
        return sizes

    @property
    def dropped(self) -> str:
        """Say, after the word tiles, which ones are left out of the gallery."""
        least = self.least_valid_share
        if least in ("none", 0.0):
            return "without valid pixels"
        return f"with less than {100 * float(least):g}% of valid pixels"


class GroundTruth(Strict):
    """Which tiles answer a query, from rays cast through four anchor pixels."""

    rule: Literal["plane", "dsm", "iou"]
    anchor_inset: Annotated[float, Field(ge=0, lt=0.5)]
    max_range_m: Positive
    box_growth: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    iou_above: Annotated[float, Field(ge=0, lt=1)] | None = None
    without_positive: Literal["exclude", "miss"]

    @model_validator(mode="after")
    def _threshold_belongs_to_iou(self) -> GroundTruth:
        if (self.rule == "iou") != (self.iou_above is not None):
            raise ValueError("iou_above is given with rule = 'iou', and only then")
        return self


class RetrievalScores(Strict):
    """What is computed from a ranked gallery."""

    descriptor_metric: Literal["l2", "cosine", "inner_product"]
    ranks_kept: Annotated[int, Field(ge=1, le=1000)]
    recall_at: Ranks
    ap_at: Annotated[int, Field(ge=1, le=1000)]
    ap: ApVariant
    ndcg_at: Ranks
    distance_below_m: Limits
    sdm_at: Ranks
    sdm_scale_per_m: Positive
    pdm_at: Ranks
    pdm_steepness: Positive
    pdm_tolerance_tiles: Positive

    @model_validator(mode="after")
    def _kept_ranks_suffice(self) -> RetrievalScores:
        deepest = max(*self.recall_at, self.ap_at, *self.ndcg_at, *self.sdm_at, *self.pdm_at)
        if self.ranks_kept < deepest:
            raise ValueError(f"ranks_kept must reach the deepest score, {deepest}")
        return self

    @property
    def depth(self) -> int:
        """The deepest rank that a headline score (recall, AP) reads."""
        return max(*self.recall_at, self.ap_at)


class RetrievalProtocol(Protocol):
    """A protocol of aerial image retrieval."""

    truth_sections: ClassVar[tuple[str, ...]] = ("gallery", "ground_truth")

    track: Literal["retrieval"]
    gallery: Gallery
    ground_truth: GroundTruth
    scores: RetrievalScores
