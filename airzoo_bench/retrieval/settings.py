"""Settings of the protocols of the retrieval track."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from airzoo_bench.core.errors import ProtocolError
from airzoo_bench.core.validation import Positive, Ranks, Strict, Thresholds
from airzoo_bench.protocol.model import Protocol

ApVariant = Literal["precision", "min", "trec", "hits"]
Metric = Literal["l2", "cosine", "inner_product"]
WithoutPositive = Literal["exclude", "miss"]
Share = Annotated[float, Field(ge=0, le=1)]
RankNumber = Annotated[int, Field(ge=1, le=1000)]


class MapGallery(Strict):
    """How the georeferenced map is cut into tiles."""

    tile_sizes_px: Annotated[
        tuple[Annotated[int, Field(ge=16, le=8192)], ...], Field(min_length=1, max_length=8)
    ]
    overlap: Annotated[float, Field(ge=0, lt=1)]
    gsd_m: Positive | Literal["any"]
    gsd_tolerance: Annotated[float, Field(gt=0, lt=1)]
    least_valid_share: Share | Literal["none"]

    @field_validator("tile_sizes_px")
    @classmethod
    def _sizes_differ(cls, sizes: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(sizes)) != len(sizes):
            raise ValueError("each tile size once")
        return sizes

    @property
    def dropped(self) -> str:
        """Say, after the word tiles, which ones are left out of the gallery."""
        if self.least_valid_share in ("none", 0.0):
            return "without valid pixels"
        return f"with less than {100 * float(self.least_valid_share):g}% of valid pixels"


class ImageGallery(Strict):
    """A folder of images that the benchmark gives, and how it states their positions."""

    source: Literal["images"]
    positions: Literal["none", "degrees", "metres"]
    dropped: ClassVar[str] = ""


class GeometricRules(Strict):
    """Which tiles answer a query, from rays cast through four anchor pixels."""

    rule: Literal["plane", "dsm", "iou"]
    anchor_inset: Annotated[float, Field(ge=0, lt=0.5)]
    max_range_m: Positive
    box_growth: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    iou_above: Annotated[float, Field(ge=0, lt=1)] | None = None
    without_positive: WithoutPositive

    @model_validator(mode="after")
    def _threshold_belongs_to_iou(self) -> GeometricRules:
        if (self.rule == "iou") != (self.iou_above is not None):
            raise ValueError("iou_above is given with rule = 'iou', and only then")
        return self


class StatedRules(Strict):
    """Which images answer a query, as the benchmark states by class labels or pairs."""

    rule: Literal["labels", "pairs"]
    pairs: Literal["positive"] | None = None
    without_positive: WithoutPositive

    @model_validator(mode="after")
    def _pairs_belong_to_pairs(self) -> StatedRules:
        if (self.rule == "pairs") != (self.pairs is not None):
            raise ValueError("pairs is given with rule = 'pairs', and only then")
        return self


class TileScores(Strict):
    """Scores of a ranked gallery of tiles that are cut from a map."""

    descriptor_metric: Metric
    ranks_kept: RankNumber
    recall_at: Ranks
    ap_at: RankNumber
    ap: ApVariant
    ndcg_at: Ranks
    distance_below_m: Thresholds
    sdm_at: Ranks
    sdm_scale_per_m: Positive
    pdm_at: Ranks
    pdm_steepness: Positive
    pdm_tolerance_tiles: Positive

    @model_validator(mode="after")
    def _check_ranks_kept(self) -> TileScores:
        if self.ranks_kept < self.ranks_scored:
            raise ValueError(f"ranks_kept must reach the deepest score, {self.ranks_scored}")
        return self

    @property
    def ranks_scored(self) -> int:
        """How many ranks the scores that name one read."""
        return max(self.tie_ranks, *self.ndcg_at, *self.sdm_at, *self.pdm_at)

    @property
    def tie_ranks(self) -> int:
        """How many ranks recall and AP read: a tie that begins beyond decides nothing."""
        return max(*self.recall_at, self.ap_at)


class DistanceScores(Strict):
    """Scores of the positions of images, as the benchmark's own code computes them."""

    metres: Literal["sphere", "ellipsoid", "plane"]
    sdm_at: Ranks
    sdm_unit: Literal["metre", "degree"]
    sdm_scale: Positive
    ma_below_m: Thresholds
    dis_at: Ranks


class ImageScores(Strict):
    """Scores of a ranked gallery of images, as the benchmarks' own code computes them."""

    descriptor_metric: Metric
    ranks_kept: RankNumber
    recall_at: Ranks
    recall_at_share: Annotated[float, Field(gt=0, lt=1)]
    ap: Literal["trapezoid", "trec"]
    distances: DistanceScores | None = None

    @model_validator(mode="after")
    def _check_ranks_kept(self) -> ImageScores:
        near = self.distances
        deepest = max(*self.recall_at, *(near.sdm_at + near.dis_at if near else ()))
        if self.ranks_kept < deepest:
            raise ValueError(f"ranks_kept must reach the deepest score, {deepest}")
        return self

    @property
    def tie_ranks(self) -> int:
        """How many ranks the recalls read; average precision reads the whole list."""
        return max(self.recall_at)


def _by(images: type[Strict], of_images: Callable[[dict[str, Any]], bool]) -> Discriminator:
    """Choose between the section for a map and that for images, by keys that only one has."""

    def kind(values: Any) -> str:
        found = of_images(values) if isinstance(values, dict) else isinstance(values, images)
        return "<images>" if found else "<map>"

    return Discriminator(kind)


class RetrievalProtocol(Protocol):
    """A protocol of aerial image retrieval.

    The gallery is either cut from a map, with a truth by geometry, or a set of images, with a
    truth that the benchmark states.
    """

    truth_sections: ClassVar[tuple[str, ...]] = ("gallery", "ground_truth")

    track: Literal["retrieval"]
    gallery: Annotated[
        Annotated[MapGallery, Tag("<map>")] | Annotated[ImageGallery, Tag("<images>")],
        _by(ImageGallery, lambda values: "source" in values),
    ]
    ground_truth: Annotated[
        Annotated[GeometricRules, Tag("<map>")] | Annotated[StatedRules, Tag("<images>")],
        _by(
            StatedRules,
            lambda truth: truth.get("rule") in ("labels", "pairs") and "anchor_inset" not in truth,
        ),
    ]
    scores: Annotated[
        Annotated[TileScores, Tag("<map>")] | Annotated[ImageScores, Tag("<images>")],
        _by(ImageScores, lambda values: "recall_at_share" in values),
    ]

    def map_rules(self) -> tuple[MapGallery, GeometricRules]:
        """Return how the map is cut into tiles, and which of them answer."""
        gallery, truth = self.gallery, self.ground_truth
        if isinstance(gallery, ImageGallery) or isinstance(truth, StatedRules):
            raise ProtocolError(
                f"protocol {self.name} has a gallery of images that its benchmark gives",
                expected="one whose gallery is cut from a map",
                fix="take photos-retrieval, or a protocol made from it",
            )
        return gallery, truth

    @model_validator(mode="after")
    def _sections_fit(self) -> RetrievalProtocol:
        stated = isinstance(self.gallery, ImageGallery)
        if isinstance(self.ground_truth, StatedRules) != stated:
            raise ValueError(
                "rule 'labels' or 'pairs' needs [gallery] source = 'images', and only they have it"
            )
        if isinstance(self.scores, ImageScores) != stated:
            raise ValueError(
                "recall_at_share is a score of [gallery] source = 'images', and only of that"
            )
        if isinstance(self.gallery, ImageGallery) and isinstance(self.scores, ImageScores):
            _check_positions(self.gallery.positions, self.scores.distances)
        return self


def _check_positions(positions: str, scores: DistanceScores | None) -> None:
    """Refuse scores that need positions which the benchmark does not give, or gives otherwise."""
    if (scores is None) != (positions == "none"):
        raise ValueError("[scores.distances] is given with positions of the gallery's images")
    if scores is None:
        return
    if (scores.metres == "plane") != (positions == "metres"):
        raise ValueError("metres = 'plane' is for positions in metres, the others for degrees")
    if positions == "metres" and scores.sdm_unit == "degree":
        raise ValueError("sdm_unit = 'degree' needs positions in degrees")
