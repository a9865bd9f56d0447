"""What a protocol of the reconstruction track states."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from airzoo_bench.settings import Limits, Positive, Strict

__all__ = ["Alignment", "Fusion", "Meshes", "Preparation", "ReconstructionScores"]

Seed = Annotated[int, Field(ge=0, lt=2**31)]
Count = Annotated[int, Field(ge=1)]


class Alignment(Strict):
    """How a prediction is brought into the frame of the truth.

    The values of `icp_*` are used by ``sim3+icp`` only.
    """

    method: Literal["none", "sim3", "sim3+icp"]
    inlier_below_m: Positive
    trials: Count
    seed: Seed
    icp_below_m: Positive
    icp_points: Count
    icp_iterations: Count


class Fusion(Strict):
    """How depth maps and point maps become a cloud."""

    method: Literal["back-projection", "tsdf"]
    confidence_above: Annotated[float, Field(allow_inf_nan=False)] | Literal["none"]
    max_depth_m: Positive
    tsdf_voxel_m: Positive
    tsdf_truncation_m: Positive


class Meshes(Strict):
    """How a surface becomes points."""

    points_per_m2: Positive
    seed: Seed


class Preparation(Strict):
    """What is done to both clouds before distances are taken."""

    crop_margin_m: Annotated[float, Field(ge=0, allow_inf_nan=False)] | Literal["none"]
    voxel_m: Positive | Literal["none"]


class ReconstructionScores(Strict):
    """Distances below which points count as right, all strict."""

    f1_below_m: Limits
    headline_below_m: Positive
    curve_up_to_m: Positive
    curve_steps: Annotated[int, Field(ge=2, le=10_000)]
    pose_auc_below_deg: Limits
