"""The settings in a protocol of the reconstruction track."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from airzoo_bench.core.validation import Count, Positive, Seed, Strict, Thresholds
from airzoo_bench.formats.clouds.cloud import MeshSampling
from airzoo_bench.protocol.model import Protocol

Trials = Annotated[int, Field(ge=1, le=1_000_000)]
Share = Annotated[float, Field(gt=0, le=1)]
Distance = Annotated[float, Field(ge=0, le=1e12, allow_inf_nan=False)]


class AlignmentSettings(Strict):
    """How a prediction is brought into the frame of the truth.

    Trials end once a sample without outliers was drawn with the confidence. Centres whose second
    singular value is at most `line_ratio` of the first lie on a line. There, an orientation weighs
    as much as points so far off the line.
    """

    method: Literal["none", "sim3", "sim3+icp"]
    cameras: Literal["required", "optional"]
    inlier_below_m: Positive
    inlier_below_deg: Positive
    sample_share: Literal["minimal"]
    min_trials: Trials
    max_trials: Trials
    confidence: Share
    line_ratio: Share
    seed: Seed
    icp_below_m: Positive
    icp_points: Count
    icp_iterations: Annotated[int, Field(ge=1, le=100_000)]
    icp_tolerance: Positive
    icp_with_scale: bool


class Fusion(Strict):
    """How depth maps and point maps become a cloud; the values of `tsdf_*` serve ``tsdf`` only."""

    method: Literal["back-projection", "tsdf"]
    confidence_above: Annotated[float, Field(allow_inf_nan=False)] | Literal["none"]
    max_depth_m: Positive
    tsdf_voxel_m: Positive
    tsdf_truncation_m: Positive
    tsdf_max_voxels: Count

    @model_validator(mode="after")
    def _truncation_spans_voxels(self) -> Self:
        if self.tsdf_truncation_m < self.tsdf_voxel_m:
            raise ValueError("tsdf_truncation_m must be at least tsdf_voxel_m")
        return self

    @property
    def least_confidence(self) -> float | None:
        """The confidence that pixels must exceed; None takes all."""
        return None if isinstance(self.confidence_above, str) else self.confidence_above


class Meshes(Strict):
    """How many points are sampled on a mesh, whatever its units."""

    points: Annotated[int, Field(ge=1, le=100_000_000)]
    seed: Seed

    @property
    def sampling(self) -> MeshSampling:
        """The settings, as readers of meshes take them."""
        return MeshSampling(self.seed, self.points, per_square_unit=None, max_points=self.points)


class Preparation(Strict):
    """How both clouds are prepared before distances are measured."""

    crop: Literal["covered", "none"]
    crop_margin_m: Distance
    crop_cell_m: Positive
    region: Literal["observed", "all"]
    observed_photos: Count
    observed_cell_m: Positive
    hidden_beyond_m: Positive
    voxel_m: Positive | Literal["none"]


class ReconstructionScores(Strict):
    """Distances below which points count as right, all strict."""

    f1_below_m: Thresholds
    headline_below_m: Positive
    curve_up_to_m: Positive
    curve_steps: Annotated[int, Field(ge=2, le=10_000)]
    pose_auc_below_deg: Thresholds
    pose_auc_rule: Literal["exact", "depth-anything-3"]
    least_baseline_m: Distance
    trajectory_alignment: Literal["umeyama", "cloud"]
    max_distance_m: Positive | Literal["none"]

    @model_validator(mode="after")
    def _angles_are_angles(self) -> Self:
        whole = all(limit.is_integer() for limit in self.pose_auc_below_deg)
        if self.pose_auc_rule == "depth-anything-3" and not whole:
            raise ValueError("pose_auc_below_deg must be whole degrees for depth-anything-3")
        if self.pose_auc_below_deg[-1] > 180.0:
            raise ValueError("pose_auc_below_deg are angles, at most 180")
        return self

    @property
    def finest_m(self) -> float:
        """The least distance that is scored."""
        return min(*self.f1_below_m, self.headline_below_m)


class ReconstructionProtocol(Protocol):
    """A protocol of multi-view reconstruction."""

    track: Literal["reconstruction"]
    alignment: AlignmentSettings
    fusion: Fusion
    meshes: Meshes
    preparation: Preparation
    scores: ReconstructionScores

    @model_validator(mode="after")
    def _voxels_below_scores(self) -> Self:
        voxel, finest = self.preparation.voxel_m, self.scores.finest_m
        if not isinstance(voxel, str) and finest < 2 * voxel:
            raise ValueError(f"thresholds ({finest:g} m) must be at least two voxels ({voxel:g} m)")
        return self
