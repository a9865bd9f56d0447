"""From what a method claims of a scene to a cloud in the frame of the truth, ready to compare."""

from __future__ import annotations

from dataclasses import dataclass, replace

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.plurals import counted
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment.cameras import Alignment, align, refined
from airzoo_bench.reconstruction.alignment.consensus import PosedCameras
from airzoo_bench.reconstruction.alignment.icp import refine
from airzoo_bench.reconstruction.alignment.similarity import AlignmentError, Similarity
from airzoo_bench.reconstruction.cells import CellSet
from airzoo_bench.reconstruction.fusion import DepthCloud, DepthMaps, PointCloudOfMaps, PointMaps
from airzoo_bench.reconstruction.observed import observed_cells
from airzoo_bench.reconstruction.prepared import (
    InMemoryCloud,
    PreparedCloud,
    TransformedCloud,
    box_of,
    cropped_region,
    finite_pieces,
    prepared,
)
from airzoo_bench.reconstruction.regions import Box
from airzoo_bench.reconstruction.settings import Alignment as AlignmentSettings
from airzoo_bench.reconstruction.settings import Fusion, Preparation, ReconstructionScores
from airzoo_bench.reconstruction.tsdf import fuse

__all__ = [
    "AlignedScene",
    "BlockWork",
    "MatchedPrediction",
    "ScoringSettings",
    "TrueScene",
    "align_scene",
]


@dataclass(frozen=True)
class ScoringSettings:
    """What a protocol states, by section."""

    alignment: AlignmentSettings
    fusion: Fusion
    preparation: Preparation
    scores: ReconstructionScores


@dataclass(frozen=True)
class BlockWork:
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
class MatchedPrediction:
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
class TrueScene:
    """What a claim is held against.

    Attributes
    ----------
    cloud : CloudSource
    cameras : PosedCameras
        All true cameras, by the names of their photos.
    lenses : Cameras
        Their intrinsics.
    """

    cloud: CloudSource
    cameras: PosedCameras
    lenses: Cameras


@dataclass(frozen=True, eq=False)
class AlignedScene:
    """A claim and the truth as they are compared.

    Attributes
    ----------
    alignment : Alignment
    cloud, truth : PreparedCloud
    observed : CellSet or None
        What the photos saw of the truth; None where recall is over all of it.
    distrusted : int
        Points of the claim whose confidence is not above the protocol's.
    """

    alignment: Alignment
    cloud: PreparedCloud
    truth: PreparedCloud
    observed: CellSet | None
    distrusted: int


def align_scene(
    claim: MatchedPrediction, truth: TrueScene, rules: ScoringSettings, work: BlockWork
) -> AlignedScene:
    """Do all that is done to a claim, and to the truth, before they are compared.

    Parameters
    ----------
    claim : MatchedPrediction
    truth : TrueScene
    rules : ScoringSettings
    work : BlockWork

    Raises
    ------
    PredictionError
        It has no cameras, and the protocol requires them; it cannot be aligned, read or fused, or
        all of its points are NaN or infinite.
    BenchmarkError
        The true cloud has no point, or none that the photos see.
    """
    _require_cameras(claim, rules.alignment)
    box, block = box_of(truth.cloud), work.block_points
    alignment, source = _aligned(claim, truth, rules, work)
    region = cropped_region(truth.cloud, box, rules.preparation, block)
    cloud = prepared(source, rules.preparation, region, block)
    _refuse_nothing_finite(cloud)
    distrusted = _distrusted(claim, alignment.transform, rules.fusion, block)
    true = prepared(truth.cloud, rules.preparation, region, block)
    observed = _observed(true, box, truth, rules.preparation, block)
    return AlignedScene(alignment, cloud, true, observed, distrusted)


def _require_cameras(claim: MatchedPrediction, settings: AlignmentSettings) -> None:
    if settings.cameras == "required" and claim.cameras is None:
        raise PredictionError(
            "holds no cameras, and the protocol requires them",
            expected="cameras, by which all methods are aligned alike",
            fix="add SCENE.cameras.npz, or choose a protocol whose cameras are optional",
        )


def _observed(
    true: PreparedCloud, box: Box, truth: TrueScene, settings: Preparation, block: int
) -> CellSet | None:
    cameras = truth.cameras
    if settings.region == "all" or cameras.rotation is None:
        return None
    return observed_cells(
        finite_pieces(true.source, block),
        box,
        truth.lenses,
        Poses(rotation=cameras.rotation, centres=cameras.centres),
        cell=settings.observed_cell_m,
        hidden_beyond=settings.hidden_beyond_m,
        photos=settings.observed_photos,
    )


def _aligned(
    claim: MatchedPrediction, truth: TrueScene, rules: ScoringSettings, work: BlockWork
) -> tuple[Alignment, CloudSource]:
    """Align by cameras, fuse in metres, then refine by the fused cloud where that is asked for."""
    settings, cameras = rules.alignment, truth.cameras
    if claim.cameras is None or settings.method == "none":
        found = align("none", claim.cameras, cameras, ransac=None)
        return found, _in_frame(claim, found.transform, rules.fusion)
    found = align(settings.method, claim.cameras, cameras, ransac=settings.ransac())
    source = _in_frame(claim, found.transform, rules.fusion)
    if settings.method != "sim3+icp":
        return found, source
    try:
        step, report = refine(source, truth.cloud, settings.icp(), held_points=work.block_points)
    except AlignmentError as fault:
        # A cloud that is nowhere near the truth has failed; that is no fault of its file.
        return replace(found, icp_failure=fault.what), source
    return refined(found, step, report, claim.cameras, cameras), TransformedCloud(
        source, step, None
    )


def _in_frame(claim: MatchedPrediction, transform: Similarity, fusion: Fusion) -> CloudSource:
    geometry, least = claim.geometry, fusion.least_confidence
    if isinstance(geometry, PointMaps):
        return PointCloudOfMaps(geometry, transform, least)
    if not isinstance(geometry, DepthMaps):
        return TransformedCloud(geometry, transform, least)
    if fusion.method == "tsdf":
        return InMemoryCloud(fuse(geometry, transform, fusion.tsdf(), confidence_above=least))
    return DepthCloud(geometry, transform, fusion.max_depth_m, least)


def _distrusted(
    claim: MatchedPrediction, transform: Similarity, fusion: Fusion, points: int
) -> int:
    geometry, least = claim.geometry, fusion.least_confidence
    if least is None:
        return 0
    if isinstance(geometry, PointMaps):
        everything = PointCloudOfMaps(geometry, transform, None).count
        return everything - PointCloudOfMaps(geometry, transform, least).count
    if isinstance(geometry, DepthMaps):
        everything = DepthCloud(geometry, transform, fusion.max_depth_m, None).count
        return everything - DepthCloud(geometry, transform, fusion.max_depth_m, least).count
    sources = TransformedCloud(geometry, Similarity.identity(), least).pieces(points)
    return geometry.count - sum(len(piece) for piece in sources)


def _refuse_nothing_finite(cloud: PreparedCloud) -> None:
    if cloud.not_finite and not (cloud.source.count or cloud.outside):
        raise PredictionError(
            f"all {counted(cloud.not_finite, 'point has', 'points have')} a coordinate that is "
            "NaN, infinite or too large to compute with",
            expected="finite coordinates",
            fix="write the cloud again, without points that were not reconstructed",
        )
