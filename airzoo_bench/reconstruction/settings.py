"""What a protocol of the reconstruction track states."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from airzoo_bench.reconstruction.alignment.consensus import RansacSettings
from airzoo_bench.reconstruction.alignment.icp import IcpSettings
from airzoo_bench.reconstruction.tsdf import TsdfSettings
from airzoo_bench.settings import Count, Limits, Positive, Seed, Strict

__all__ = ["Alignment", "Fusion", "Meshes", "Preparation", "ReconstructionScores"]

_LARGEST_ANGLE_DEG = 180.0
Share = Annotated[float, Field(gt=0, le=1)]


class Alignment(Strict):
    """How a prediction is brought into the frame of the truth.

    ``inlier_below_m = "nearest-camera"`` is Depth Anything 3's rule; see `consensus`. The values of
    `icp_*` are used by ``sim3+icp`` only.
    """

    method: Literal["none", "sim3", "sim3+icp"]
    inlier_below_m: Positive | Literal["nearest-camera"]
    trials: Annotated[int, Field(ge=1, le=10_000_000)]
    sample_share: Share
    line_ratio: Share
    seed: Seed
    icp_below_m: Positive
    icp_points: Count
    icp_iterations: Annotated[int, Field(ge=1, le=100_000)]
    icp_tolerance: Positive
    icp_with_scale: bool

    def ransac(self) -> RansacSettings:
        """Return what finding inliers among camera centres needs."""
        limit = None if isinstance(self.inlier_below_m, str) else self.inlier_below_m
        return RansacSettings(self.trials, self.sample_share, limit, self.line_ratio, self.seed)

    def icp(self) -> IcpSettings:
        """Return what refining by the clouds needs."""
        return IcpSettings(
            max_points=self.icp_points,
            max_distance=self.icp_below_m,
            max_iterations=self.icp_iterations,
            tolerance=self.icp_tolerance,
            with_scale=self.icp_with_scale,
            seed=self.seed,
        )


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

    def tsdf(self) -> TsdfSettings:
        """Return what fusing by a signed distance needs."""
        return TsdfSettings(
            self.tsdf_voxel_m, self.tsdf_truncation_m, self.max_depth_m, self.tsdf_max_voxels
        )


class Meshes(Strict):
    """How a surface becomes points: so many on the whole mesh, whatever its units."""

    points: Annotated[int, Field(ge=1, le=100_000_000)]
    seed: Seed


class Preparation(Strict):
    """What is done to both clouds before distances are taken."""

    crop_margin_m: Annotated[float, Field(ge=0, le=1e12, allow_inf_nan=False)] | Literal["none"]
    voxel_m: Positive | Literal["none"]


class ReconstructionScores(Strict):
    """Distances below which points count as right, all strict."""

    f1_below_m: Limits
    headline_below_m: Positive
    curve_up_to_m: Positive
    curve_steps: Annotated[int, Field(ge=2, le=10_000)]
    pose_auc_below_deg: Limits
    least_baseline_m: Annotated[float, Field(ge=0, le=1e12, allow_inf_nan=False)]

    @model_validator(mode="after")
    def _angles_are_angles(self) -> Self:
        if self.pose_auc_below_deg[-1] > _LARGEST_ANGLE_DEG:
            raise ValueError("pose_auc_below_deg are angles, at most 180")
        return self
