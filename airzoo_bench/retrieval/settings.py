"""Settings of the protocols of the retrieval track."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from airzoo_bench.core.errors import ProtocolError
from airzoo_bench.core.validation import Positive, Ranks, Strict, Thresholds
from airzoo_bench.protocol.model import Protocol

ApVariant = Literal["precision", "min", "trec", "hits"]
Metric = Literal["l2", "cosine", "inner_product"]
WithoutPositive = Literal["exclude", "miss"]
Share = Annotated[float, Field(ge=0, le=1)]
Part = Annotated[float, Field(gt=0, lt=1)]
RankNumber = Annotated[int, Field(ge=1, le=1000)]


class MapGallery(Strict):
    """How the georeferenced map is cut into tiles."""

    tile_sizes_px: Annotated[
        tuple[Annotated[int, Field(ge=16, le=8192)], ...], Field(min_length=1, max_length=8)
    ]
    overlap: Annotated[float, Field(ge=0, lt=1)]
    gsd_m: Positive | Literal["any"]
    gsd_tolerance: Part
    least_valid_share: Share | Literal["none"]


class ImageGallery(Strict):
    """A folder of images that the benchmark gives, and how it states their positions."""

    source: Literal["images"]
    positions: Literal["none", "degrees", "metres"]


class GeometricRules(Strict):
    """Which tiles answer a query, from rays cast through four anchor pixels."""

    rule: Literal["plane", "dsm", "iou"]
    anchor_inset: Annotated[float, Field(ge=0, lt=0.5)]
    max_range_m: Positive
    box_growth: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    iou_above: Annotated[float, Field(ge=0, lt=1)] | None = None
    without_positive: WithoutPositive


class StatedRules(Strict):
    """Which images answer a query, as the benchmark states by class labels or pairs."""

    rule: Literal["labels", "pairs"]
    pairs: Literal["positive"] | None = None
    without_positive: WithoutPositive


class TileScoring(Strict):
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


class DistanceScoring(Strict):
    """Scores of the positions of images, as the benchmark's own code computes them."""

    metres: Literal["sphere", "ellipsoid", "plane"]
    sdm_at: Ranks
    sdm_unit: Literal["metre", "degree"]
    sdm_scale: Positive
    ma_below_m: Thresholds
    dis_at: Ranks


class ImageScoring(Strict):
    """Scores of a ranked gallery of images, as the benchmarks' own code computes them."""

    descriptor_metric: Metric
    ranks_kept: RankNumber
    recall_at: Ranks
    recall_at_share: Part
    ap: Literal["trapezoid", "trec"]
    distances: DistanceScoring | None = None


def _kind(section: Any) -> str:
    """Tell a section for images from that for a map."""
    values = section if isinstance(section, dict) else getattr(section, "__dict__", {})
    is_of_images = {"source", "recall_at_share"} & {*values}
    return "<images>" if is_of_images or values.get("rule") in ("labels", "pairs") else "<map>"


_MAP, _IMAGES, _KINDS = Tag("<map>"), Tag("<images>"), Discriminator(_kind)


class RetrievalProtocol(Protocol):
    """A protocol of aerial image retrieval.

    The gallery is either cut from a map, with a truth by geometry, or a set of images, with a
    truth that the benchmark states.
    """

    truth_sections: ClassVar[tuple[str, ...]] = ("gallery", "ground_truth")

    track: Literal["retrieval"]
    gallery: Annotated[Annotated[MapGallery, _MAP] | Annotated[ImageGallery, _IMAGES], _KINDS]
    ground_truth: Annotated[
        Annotated[GeometricRules, _MAP] | Annotated[StatedRules, _IMAGES], _KINDS
    ]
    scores: Annotated[Annotated[TileScoring, _MAP] | Annotated[ImageScoring, _IMAGES], _KINDS]

    def map_rules(self) -> tuple[MapGallery, GeometricRules]:
        """Return how the map is cut into tiles, and which of them answer."""
        gallery, truth = self.gallery, self.ground_truth
        if isinstance(gallery, ImageGallery) or isinstance(truth, StatedRules):
            raise ProtocolError(
                f"protocol {self.name} has a gallery of images that its benchmark gives",
                fix="take photos-retrieval, or a protocol made from it",
            )
        return gallery, truth

    @model_validator(mode="after")
    def _sections_fit(self) -> RetrievalProtocol:
        rules, distances = self.ground_truth, getattr(self.scores, "distances", None)
        positions = getattr(self.gallery, "positions", "none")
        measures = {"none": (None,), "metres": ("plane",), "degrees": ("sphere", "ellipsoid")}
        fits = len({_kind(section) for section in (self.gallery, rules, self.scores)}) == 1
        fits &= getattr(distances, "metres", None) in measures[positions]
        fits &= positions == "degrees" or getattr(distances, "sdm_unit", None) != "degree"
        if not fits:
            raise ValueError(
                "gallery, ground_truth and scores are all of a map, or all of images "
                "(source = 'images'); scores.distances go with positions, 'plane' with metres, "
                "sdm_unit = 'degree' with degrees"
            )
        if isinstance(rules, GeometricRules) and (rules.rule == "iou") == (rules.iou_above is None):
            raise ValueError("iou_above is given with rule = 'iou', and only then")
        values = [*self.scores, *(distances or ())]
        ranks = [value for name, value in values if name.endswith("_at")]
        deepest = max(max(one) if isinstance(one, tuple) else one for one in ranks)
        if self.scores.ranks_kept < deepest:
            raise ValueError(f"scores.ranks_kept must reach the deepest score, {deepest}")
        return self
