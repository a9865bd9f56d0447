"""Scenes are checked, measured, and given their truth before a folder is written."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from pyproj import CRS

from airzoo_bench.benchmark.folder import needed
from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.benchmark.queries import SceneInputs, cameras_of, photo_id, photo_table, poses_of
from airzoo_bench.core.errors import (
    BenchmarkError,
    CameraError,
    RasterError,
    UsageError,
    UserError,
    counted,
    first_of,
    readable,
)
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.facts import SceneFacts, measure_facts, measure_heights
from airzoo_bench.datasets.scenes import ImageScene, NativeScene
from airzoo_bench.datasets.truths import (
    BenchmarkProtocols,
    SceneTruths,
    build_stated_truth,
    build_truths,
)
from airzoo_bench.formats.clouds.cloud import open_cloud
from airzoo_bench.formats.clouds.las import open_shards, shards_in
from airzoo_bench.formats.photos import PHOTO_SUFFIXES
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.crs import (
    LOCAL_CRS,
    check_same_crs,
    check_true_metres,
    describe_crs,
    geodesic_distance_m,
    horizontal_crs,
    same_plane,
    to_lonlat,
    vertical_m,
)
from airzoo_bench.geometry.heightfield import (
    HeightSurvey,
    blocked_heights,
    median_height,
    survey_heights,
)
from airzoo_bench.geometry.poses import world_to_camera
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, open_info, open_raster, pixel_to_world
from airzoo_bench.retrieval.settings import RetrievalProtocol, StatedRules
from airzoo_bench.retrieval.truth import RetrievalTruth

_MOST_DSM_BANDS = 2  # heights, and perhaps a mask
# No ground is lower or higher, above sea level or ellipsoid.
_LOWEST_M, _HIGHEST_M = -1000.0, 10_000.0
_FAR_M = 100_000.0  # no photo shows ground so far away


@dataclass(frozen=True, eq=False)
class SceneContent:
    """A scene with its truth; `files` are photos, maps and clouds as benchmark.toml names them."""

    inputs: SceneInputs
    truths: SceneTruths
    files: Mapping[str, Path]
    facts: SceneFacts | None = None
    truth_accuracy_m: float | None = None
    gallery_size: int | None = None


def make_content(native: NativeScene | ImageScene, protocols: BenchmarkProtocols) -> SceneContent:
    """Check a scene, measure its parts, and make its truth for every track that they serve."""
    protocols = protocols.for_scene(native.scene)
    if isinstance(native, ImageScene):
        return _image_content(native, protocols)
    check_names(native.names, native.images)
    crs = _check_crs(native)
    survey = None if native.dsm is None else survey_surface(native.dsm)
    inputs = _inputs(native, crs)
    heights = measure_heights(inputs)
    _check_above_surface(*heights, native.dsm)
    above = None if native.cloud is None else check_cloud(native.cloud, inputs)
    truths = build_truths(inputs, protocols, native.cloud)
    if truths.retrieval is not None and truths.retrieval.queries.empty:
        raise _no_answers(truths.retrieval, native, inputs)
    facts = measure_facts(native, inputs, heights[0], survey, truths, above)
    return SceneContent(inputs, truths, native.files, facts, native.truth_accuracy_m)


def _image_content(native: ImageScene, protocols: BenchmarkProtocols) -> SceneContent:
    """Make the truth of a scene that a benchmark states by pairs of images."""
    protocol = protocols.first(RetrievalProtocol)
    if protocol is None or not isinstance(protocol.ground_truth, StatedRules):
        raise TypeError(f"scene {native.scene} has no protocol whose truth is stated")
    truth = build_stated_truth(native, protocol.ground_truth)
    photos = pd.concat([truth.queries, truth.excluded[["id", "image"]]])
    inputs = SceneInputs(native.scene, photos, None, None, None, None)
    files = {"images": native.images, "gallery": native.tiles}
    return SceneContent(inputs, SceneTruths(truth), files, gallery_size=native.gallery_size)


def _inputs(native: NativeScene, crs: str) -> SceneInputs:
    plane = native.plane_height_m
    if plane is None and native.dsm is not None:
        plane = median_height(native.dsm)
    table = photo_table(
        native.scene, native.names, native.cameras, native.poses, native.priors, plane
    )
    if native.conditions:
        ids = [photo_id(native.scene, name) for name in native.names]
        table = table.merge(pd.DataFrame({"id": ids, **native.conditions}), on="id")
    dom, gallery = (None if path is None else _map(path) for path in (native.dom, native.gallery))
    return SceneInputs(
        native.scene, table, crs, dom, native.dsm, plane, native.unposed, gallery, native.maps
    )


def _map(path: Path) -> RasterInfo:
    """Open a map, and read its last block, which a file that was cut lacks."""
    with open_raster(path) as dataset:
        *_, (_, window) = dataset.block_windows(1)
        dataset.read(1, window=window)
    return open_info(path)


def photo_sizes(folder: Path, progress: Progress) -> dict[str, tuple[int, int]]:
    """Read width and height of every photo below a folder, by name relative to it."""
    if not folder.is_dir():
        raise UsageError("no such folder of photos", where=folder)
    named = (path for path in folder.rglob("*") if path.suffix.lower() in PHOTO_SUFFIXES)
    paths = sorted(path for path in named if path.is_file())
    if not paths:
        raise BenchmarkError(
            "holds no photo", where=folder, expected="files ending in " + ", ".join(PHOTO_SUFFIXES)
        )
    shown = progress(paths, "photos", len(paths))
    return {path.relative_to(folder).as_posix(): photo_size(path) for path in shown}


def check_names(names: Sequence[str], folder: Path) -> None:
    """Refuse photos with names that would become the same id."""
    stems = Counter(Path(name).with_suffix("").as_posix() for name in names)
    twice = [stem for stem, count in stems.items() if count > 1]
    if twice:
        what = f"photos that differ in their ending only: {first_of(twice, len(names))}"
        fix = "rename these photos, or keep one of each: ids lack the endings"
        raise BenchmarkError(what, where=folder, fix=fix)


def metric_crs(named: str, where: str) -> CRS:
    """Return the CRS of poses, which must be projected and in metres."""
    try:
        crs = horizontal_crs(named)
    except UserError as error:
        raise error.inside(where) from error
    if not crs.is_projected or any(axis.unit_conversion_factor != 1 for axis in crs.axis_info):
        what = f"poses are in {describe_crs(crs)}, which is not in metres"
        fix = "transform the camera centres, rotations and the DSM to one"
        expected = "a projected CRS in metres, such as UTM"
        raise CameraError(what, where=where, expected=expected, fix=fix)
    return crs


def utm_zone(lonlat: ArrayLike) -> str:
    """Return the UTM zone of most positions (N, 2), in degrees of WGS84."""
    places = np.array(lonlat, dtype=np.float64)
    # About the first, since the middle of 179.9 and -179.9 degrees is not 0.
    places[:, 0] = (places[:, 0] - places[0, 0] + 180.0) % 360.0 - 180.0 + places[0, 0]
    lon, lat = np.median(places, axis=0).tolist()
    return f"EPSG:{(32600 if lat >= 0 else 32700) + int((lon + 180.0) // 6.0) % 60 + 1}"


def _check_crs(native: NativeScene) -> str:
    """Return the CRS of the poses and the surface model, in true metres."""
    if native.crs == LOCAL_CRS:
        return LOCAL_CRS
    source = native.poses_from or native.images
    where = native.crs_from or f"{source}, scene {native.scene}"
    crs, path = metric_crs(native.crs, where), native.dsm
    dsm = None if path is None else open_info(path)
    if dsm is not None and not same_plane(crs, dsm.crs):
        what = f"is in {describe_crs(dsm.crs)}, the poses ({source}) in {describe_crs(crs)}"
        fix = f"gdalwarp -t_srs '{crs.to_string()}' -r bilinear brings it there"
        raise RasterError(what, where=path, expected="one CRS", fix=fix)
    if dsm is not None and dsm.bands > _MOST_DSM_BANDS:
        fix = "look whether --dom and --dsm are the wrong way round"
        what = f"has {dsm.bands} bands"
        raise RasterError(what, where=path, expected="one band of heights", fix=fix)
    if dsm is not None:
        middle = pixel_to_world(dsm.transform, (dsm.width / 2, dsm.height / 2))
        away = math.dist(np.median(native.poses.centres[:, :2], axis=0), middle)
        if away > _FAR_M:
            what = f"cameras lie about {away / 1000:,.0f} km from the surface model, {path}"
            fix = "look whether x and y are exchanged, an offset was taken off, or centres are "
            fix += "translations (centre = -R_w2c.T @ t)"
            raise CameraError(what, where=source, fix=fix)
    try:
        check_true_metres(crs, to_lonlat(crs, native.poses.centres[:, :2]), where)
    except CameraError as error:
        raise error.inside(source) from error
    return crs.to_string()


def survey_surface(path: Path) -> HeightSurvey:
    """Survey the heights of a surface model, and refuse heights that no ground has."""
    found = survey_heights(path, _LOWEST_M, _HIGHEST_M)
    if not found.valid or found.beyond:
        raise RasterError(
            f"{found.beyond:,} of its {found.valid:,} heights are no heights of the ground: they "
            f"go from {found.low:.10g} to {found.high:.10g} m",
            where=path,
            fix="look at their unit (feet), or tag the number of none: gdal_edit.py -a_nodata",
        )
    return found


def _check_above_surface(heights: Floats, surface: Floats, dsm: Path | None) -> None:
    """Refuse a scene if all cameras are on or below the surface model, or else the plane z0."""
    known = np.isfinite(heights)
    if known.any() and (heights[known] <= 0.0).all():
        ground, above = np.median(surface[known]), np.median(heights[known])
        what = f"every camera is below the surface: they are at {ground + above:.1f} m, the "
        what += f"surface below them is at {ground:.1f} m (medians)"
        fix = "look at the vertical datum and unit of both (feet: gdal_edit.py -units ft)"
        raise BenchmarkError(what, where=dsm, fix=fix)


def _no_answers(truth: RetrievalTruth, native: NativeScene, inputs: SceneInputs) -> UserError:
    (reason, count), *_ = truth.excluded["reason"].value_counts().items()
    x, y, z = inputs.photos[["x", "y", "z"]].median()
    info, here = inputs.gallery_map, to_lonlat(inputs.crs, (x, y))
    reach = _REACH_M + math.hypot(*np.multiply(gsd_m(info), (info.width, info.height)))
    away = float(geodesic_distance_m(_middle(info), here))
    if away > reach:
        what = f"the map, in {describe_crs(info.crs)}, lies {away / 1000:,.1f} km from the cameras"
        if inputs.dsm is not None:
            off = geodesic_distance_m(_middle(open_info(inputs.dsm)), here) / 1000
            what += f", the surface model {off:,.1f} km"
        fix = "look at its CRS (gdal_edit.py -a_srs sets it) and geotransform, or at the poses"
        return RasterError(what, where=info.path, fix=fix)
    return BenchmarkError(
        f"no photo has a tile that answers it ({counted(count, 'photo')}: {reason}); cameras are "
        f"about ({x:.0f}, {y:.0f}, {z:.0f})",
        where=native.poses_from or native.images,
        fix="look at CRS and heights, and whether poses are world-to-camera, with x to the right, "
        "y down and z forward (OpenGL's y is up and z backward); or take other tiles",
    )


def _middle(info: RasterInfo) -> Floats:
    return to_lonlat(info.crs, pixel_to_world(info.transform, (info.width / 2, info.height / 2)))


# --- true clouds ---

# What the parts of a cloud that cannot be read in pieces may take in memory.
_CLOUD_BYTES = 8 << 30
_PIECE, _SAMPLES = 1 << 20, 1 << 16
# A true cloud is at most so far from the photos, beyond what these span themselves.
_REACH_M = 1000.0
_PHOTOS, _LEAST_LOOKING = 100, 2


def check_cloud(cloud: Path, inputs: SceneInputs) -> float:
    """Read a true cloud completely, and compare its place with cameras and surface model.

    Return the median height of the cloud above the surface model, in metres; NaN where they do not
    meet, or there is no surface model.
    """
    if not cloud.exists():
        raise UsageError("no such cloud", where=cloud)
    crs = needed(inputs.crs, "CRS", inputs.scene)
    paths = shards_in(cloud) if cloud.is_dir() else [cloud]
    for path in paths:
        if path.suffix.lower() in (".las", ".laz"):
            _check_stated_crs(path, crs)
    points = _sample_points(cloud, paths)
    low, high = points.min(axis=0), points.max(axis=0)
    centres = inputs.photos[["x", "y"]].to_numpy(np.float64)
    reach = _REACH_M + np.ptp(centres, axis=0)
    beside = (high[:2] < centres.min(axis=0) - reach) | (low[:2] > centres.max(axis=0) + reach)
    if beside.any() or (inputs.dsm is None and not _is_seen(points, inputs)):
        x, y = centres.mean(axis=0)
        what = f"lies about ({low[0]:.0f}, {low[1]:.0f}), the photos are about ({x:.0f}, {y:.0f}) "
        fix = f"transform the cloud to {crs}, or add the offset that it was reduced by"
        raise BenchmarkError(f"{what}and do not look at it", where=cloud, fix=fix)
    if inputs.dsm is None:
        return math.nan
    with blocked_heights(inputs.dsm) as surface:
        above = points[:, 2] - surface.sample(points[:, :2])
    above = above[np.isfinite(above)]
    return float(np.median(above)) if above.size else math.nan


def _sample_points(cloud: Path, paths: list[Path]) -> Floats:
    """Read all of a cloud, and return some 65,000 evenly spaced finite points."""
    if cloud.is_dir():
        source: Any = open_shards(cloud, paths)
    else:
        source = open_cloud(cloud, limit_bytes=_CLOUD_BYTES, sampling=None)
    step = max(source.count // _SAMPLES, 1)
    kept = [piece.points[::step].copy() for piece in source.pieces(_PIECE)]
    points: Floats = np.concatenate([*kept, np.empty((0, 3))])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise BenchmarkError("the true cloud holds no finite point", where=cloud)
    return points


def _check_stated_crs(cloud: Path, crs: str) -> None:
    """Refuse a LAS or LAZ cloud of another CRS by its header, or with heights not in metres."""
    with (
        readable(cloud, "its CRS cannot be read", kind=BenchmarkError),
        laspy.open(cloud, read_evlrs=False) as reader,
    ):
        stated = reader.header.parse_crs()
    if stated is None:
        return
    if crs != LOCAL_CRS:
        check_same_crs(crs, stated, f"the poses and the cloud ({cloud})")
    units = {axis.unit_conversion_factor for axis in stated.axis_info}
    if units - {1.0} or vertical_m(stated) not in (None, 1.0):
        what = f"is in {stated.name}, in units of {max(units):.10g} m"
        raise BenchmarkError(
            what, where=cloud, fix="convert it to metres, e.g. with pdal translate"
        )


def _is_seen(points: Floats, inputs: SceneInputs) -> bool:
    """Tell whether photos look at a cloud: all frames of their own lie about zero."""
    rows = np.linspace(0, len(inputs.photos) - 1, min(len(inputs.photos), _PHOTOS)).astype(int)
    photos = inputs.photos.iloc[np.unique(rows)]
    cameras, poses, looking = cameras_of(photos), poses_of(photos), 0
    for row in range(len(photos)):
        camera, local = cameras.take(row), world_to_camera(poses.take(row), points[None])[0]
        pixels = project(camera, local[None, local[:, 2] > 0.0])[0]
        inside = (pixels >= 0.0) & (pixels <= (camera.width[0], camera.height[0]))
        looking += bool(inside.all(axis=1).any())
    return looking >= min(len(photos), _LEAST_LOOKING)
