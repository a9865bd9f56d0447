"""From what a method claims of a scene to a cloud in the frame of the truth, ready to compare."""

from __future__ import annotations

from dataclasses import dataclass

from airzoo_bench.errors import PredictionError
from airzoo_bench.progress import Progress, silent
from airzoo_bench.reconstruction.alignment.cameras import Alignment, align, refined
from airzoo_bench.reconstruction.alignment.consensus import PosedCameras
from airzoo_bench.reconstruction.alignment.icp import refine
from airzoo_bench.reconstruction.alignment.similarity import Similarity
from airzoo_bench.reconstruction.clouds import CloudSource
from airzoo_bench.reconstruction.fusion import DepthCloud, DepthMaps, PointCloudOfMaps, PointMaps
from airzoo_bench.reconstruction.prepared import Held, Moved, PreparedCloud, box_of, prepared
from airzoo_bench.reconstruction.settings import Alignment as AlignmentSettings
from airzoo_bench.reconstruction.settings import Fusion, Preparation, ReconstructionScores
from airzoo_bench.reconstruction.tsdf import fuse

__all__ = ["Claim", "PlacedClaim", "Rules", "Work", "place_claim"]


@dataclass(frozen=True)
class Rules:
    """What a protocol states, by section."""

    alignment: AlignmentSettings
    fusion: Fusion
    preparation: Preparation
    scores: ReconstructionScores


@dataclass(frozen=True)
class Work:
    """How the work is done; no number depends on it.

    Attributes
    ----------
    block_points : int
        Clouds of more points are worked in blocks on disk.
    threads : int
    progress : Progress
    """

    block_points: int
    threads: int
    progress: Progress = silent


@dataclass(frozen=True, eq=False)
class Claim:
    """What a method claims of a scene.

    Attributes
    ----------
    scene : str
    geometry : CloudSource, DepthMaps or PointMaps
    cameras : PosedCameras or None
        By the names that the truth has; None where the prediction holds none.
    """

    scene: str
    geometry: CloudSource | DepthMaps | PointMaps
    cameras: PosedCameras | None


@dataclass(frozen=True, eq=False)
class PlacedClaim:
    """A claim and the truth as they are compared.

    Attributes
    ----------
    alignment : Alignment
    cloud, truth : PreparedCloud
    distrusted : int
        Points of the claim whose confidence is not above the protocol's.
    """

    alignment: Alignment
    cloud: PreparedCloud
    truth: PreparedCloud
    distrusted: int


def place_claim(
    claim: Claim, truth: CloudSource, cameras: PosedCameras, rules: Rules, work: Work
) -> PlacedClaim:
    """Do all that is done to a claim, and to the truth, before they are compared.

    Parameters
    ----------
    claim : Claim
    truth : CloudSource
        The true cloud.
    cameras : PosedCameras
        All true cameras.
    rules : Rules
    work : Work

    Raises
    ------
    PredictionError
        It cannot be aligned, read or fused, or all of its points are NaN or infinite.
    BenchmarkError
        The true cloud has no point.
    """
    box = box_of(truth)
    alignment, source = _aligned(claim, truth, cameras, rules, work)
    cloud = prepared(source, rules.preparation, box, work.block_points)
    _refuse_nothing_finite(cloud)
    distrusted = _distrusted(claim, alignment.transform, rules.fusion, work.block_points)
    true = prepared(truth, rules.preparation, box, work.block_points)
    return PlacedClaim(alignment, cloud, true, distrusted)


def _aligned(
    claim: Claim, truth: CloudSource, cameras: PosedCameras, rules: Rules, work: Work
) -> tuple[Alignment, CloudSource]:
    """Align by cameras, fuse in metres, then refine by the fused cloud where that is asked for."""
    settings = rules.alignment
    if claim.cameras is None or settings.method == "none":
        found = align("none", claim.cameras, cameras, ransac=None)
        return found, _in_frame(claim, found.transform, rules.fusion)
    found = align(settings.method, claim.cameras, cameras, ransac=settings.ransac())
    source = _in_frame(claim, found.transform, rules.fusion)
    if settings.method != "sim3+icp":
        return found, source
    step, report = refine(source, truth, settings.icp(), held_points=work.block_points)
    return refined(found, step, report, claim.cameras, cameras), Moved(source, step, None)


def _in_frame(claim: Claim, transform: Similarity, fusion: Fusion) -> CloudSource:
    geometry, least = claim.geometry, fusion.least_confidence
    if isinstance(geometry, PointMaps):
        return PointCloudOfMaps(geometry, transform, least)
    if not isinstance(geometry, DepthMaps):
        return Moved(geometry, transform, least)
    if fusion.method == "tsdf":
        return Held(fuse(geometry, transform, fusion.tsdf(), confidence_above=least))
    return DepthCloud(geometry, transform, fusion.max_depth_m, least)


def _distrusted(claim: Claim, transform: Similarity, fusion: Fusion, points: int) -> int:
    geometry, least = claim.geometry, fusion.least_confidence
    if least is None:
        return 0
    if isinstance(geometry, PointMaps):
        everything = PointCloudOfMaps(geometry, transform, None).count
        return everything - PointCloudOfMaps(geometry, transform, least).count
    if isinstance(geometry, DepthMaps):
        everything = DepthCloud(geometry, transform, fusion.max_depth_m, None).count
        return everything - DepthCloud(geometry, transform, fusion.max_depth_m, least).count
    sources = Moved(geometry, Similarity.identity(), least).pieces(points)
    return geometry.count - sum(len(piece) for piece in sources)


def _refuse_nothing_finite(cloud: PreparedCloud) -> None:
    if cloud.not_finite and not (cloud.source.count or cloud.outside):
        raise PredictionError(
            f"all {cloud.not_finite:,} points have a coordinate that is NaN or infinite",
            expected="finite coordinates",
            mend="write the cloud again, without points that were not reconstructed",
        )
