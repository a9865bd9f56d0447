"""The truth of a scene of the matching track: queries, crops and maps; made, written and read."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import rasterio
import rasterio.shutil
from numpy.typing import NDArray
from rasterio.io import MemoryFile

from airzoo_bench.benchmark.folder import Benchmark, needed
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    POSE_COLUMNS,
    PRIOR_COLUMNS,
    SceneInputs,
    cameras_of,
    poses_of,
    read_excluded,
    read_queries,
    with_unposed,
)
from airzoo_bench.benchmark.tables import read_table, refuse_cells
from airzoo_bench.core.errors import BenchmarkError, RasterError, readable
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.geometry.arrays import Ints
from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project
from airzoo_bench.geometry.crs import change_of_plane, check_same_crs
from airzoo_bench.geometry.heightfield import HeightField, blocked_heights
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    open_info,
    open_raster,
    pixel_to_world,
    raster_sha256,
    to_map_pixels,
    world_to_pixel,
)
from airzoo_bench.geometry.rays import NearestHeights, intersect_heightfield, meet_missing
from airzoo_bench.matching.metrics import count_near
from airzoo_bench.matching.protocol import Crop, Prior
from airzoo_bench.storage.urls import ensure_file

CROP_COLUMNS = ("crop_x", "crop_y", "crop_width", "crop_height")
_GRID = ("width", "height", "a", "b", "c", "d", "e", "f")
_ANEW = "prepare the benchmark again"
# No GPS and no gimbal is as good as this in half of the photos. A truth that went through EXIF and
# XMP comes back with the rounding of their digits: 3 mm, and up to 0.09 degrees where each of three
# angles has one decimal.
_SAME_M, _SAME_DEG = 0.02, 0.1
# A few hundred rays at a time: what they need of the DSM fits into the blocks kept.
_CAMERAS = 64
# Pixels are rounded to this before they are made whole, so that two builds of PROJ give one crop.
_DECIMALS = 6
# Along each side of a window that is taken to another CRS, where sides bend.
_SIDE_POINTS = 33

PixelWindow = tuple[int, ...]  # x, y, width and height


class CropStatus(StrEnum):
    """The end of a crop; its text is the reason why a photo is left out."""

    CROPPED = "cropped"
    NO_PRIOR = "no GPS position or gimbal angles in the metadata"
    NO_MAP = "no map of its own"
    OFF_MAP = "by the prior pose, it does not see the map"
    NO_RAY = "by the prior pose, no corner of the image has a ray"


@dataclass(frozen=True, eq=False)
class ReferenceMap:
    """A map, used for its georeference alone, and the surface model below it."""

    dom: RasterInfo
    dsm: Path
    dsm_sha256: str

    @property
    def grid(self) -> dict[str, Any]:
        """Size, geotransform and CRS of the map."""
        transform = [float(value) for value in self.dom.transform[:6]]
        size = {"width": self.dom.width, "height": self.dom.height}
        return {**size, "transform": transform, "crs": self.dom.crs.to_string()}


@dataclass(frozen=True, eq=False)
class MatchingTruth:
    """Queries with cameras, poses, priors and crops, and the rasters that they are lifted by."""

    scene: str
    queries: pd.DataFrame  # a row a query, sorted by id
    crops: Ints  # (Q, 4), the window of each query in its map: x, y, width, height
    maps: tuple[ReferenceMap, ...]  # one of the whole scene, or one a query
    excluded: pd.DataFrame  # photos that are no queries, with the reason
    map_per_query: bool = False  # each query has a map of its own
    accuracy_m: float = 0.0  # standard error of the true positions, where it is stated

    def map_of(self, query: int) -> ReferenceMap:
        """Return the map that a query is matched to."""
        return self.maps[query if self.map_per_query else 0]

    @cached_property
    def cameras(self) -> Cameras:
        """Cameras of the Q queries."""
        return cameras_of(self.queries)

    @property
    def has_poses(self) -> bool:
        """Whether the true poses are known, as they are unless the benchmark is sealed."""
        return set(POSE_COLUMNS) <= set(self.queries.columns)

    @cached_property
    def poses(self) -> Poses:
        """True poses of the Q queries."""
        return poses_of(self.queries)

    @cached_property
    def priors(self) -> Poses:
        """Prior poses of the Q queries."""
        return poses_of(self.queries, PRIOR_COLUMNS)

    @property
    def fingerprint(self) -> str:
        """SHA-256 over all that a score is computed from."""
        digest = hashlib.sha256("\n".join(self.queries["id"]).encode() + b"\0")
        cameras, poses = self.cameras, self.poses
        for array in (
            *(cameras.width, cameras.height, cameras.focal, cameras.principal_point),
            *(cameras.distortion, poses.rotation, poses.centres, self.crops),
        ):
            digest.update(array.astype("<f8").tobytes())
        for one in self.maps:
            digest.update(repr([*one.grid.values()]).encode() + one.dsm_sha256.encode())
        return digest.hexdigest()


def with_truth_as_prior(queries: pd.DataFrame) -> pd.DataFrame:
    """Return the queries with their true poses as priors, for a protocol that says so."""
    pairs = zip(PRIOR_COLUMNS, POSE_COLUMNS, strict=True)
    return queries.assign(**{prior: queries[pose] for prior, pose in pairs})


def photo_maps(folder: Path, photo: str) -> tuple[Path, Path]:
    """Return the files of a photo's own map and surface model."""
    name = photo.split("/", 1)[1]
    return folder / f"{name}_dom.tif", folder / f"{name}_dsm.tif"


# --- written and read ---


def write_truth(folder: Path, truth: MatchingTruth) -> None:
    """Write a scene's truth below its folder, next to ``queries.csv``."""
    home, ids = folder / "matching", truth.queries[["id"]].reset_index(drop=True)
    home.mkdir(parents=True, exist_ok=True)
    crops = dict(zip(CROP_COLUMNS, truth.crops.T, strict=True))
    tables = {"crops.csv": ids.assign(**crops), "excluded.csv": truth.excluded}
    if truth.map_per_query:
        grids = pd.DataFrame([one.grid for one in truth.maps])
        letters = pd.DataFrame(grids.pop("transform").tolist(), columns=_GRID[2:]).map(repr)
        sums = pd.DataFrame({"dsm_sha256": [one.dsm_sha256 for one in truth.maps]})
        parts = (ids, grids[["width", "height"]], letters, grids["crs"], sums)
        tables["maps.csv"] = pd.concat(parts, axis=1)
    else:
        (home / "map.json").write_text(json.dumps(truth.maps[0].grid, indent=1) + "\n", "utf-8")
    for name, table in tables.items():
        table.to_csv(home / name, index=False, lineterminator="\n")


def read_truth(benchmark: Benchmark, scene: str) -> MatchingTruth:
    """Read a scene's truth, and check that its surface model and map are the prepared ones."""
    folder, entry = benchmark.scene_folder(scene), benchmark.scene(scene)
    excluded = read_excluded(benchmark, scene, "matching")
    prior = benchmark.file.tracks.get("matching", {}).get("prior", {}).get("source")
    is_truth = prior in ("truth", "given")
    poses = () if benchmark.is_sealed else POSE_COLUMNS
    columns = (*CAMERA_COLUMNS, *poses, *(() if is_truth else PRIOR_COLUMNS))
    queries = read_queries(folder, excluded, columns)
    if is_truth:
        queries = with_truth_as_prior(queries)
    home, ids = folder / "matching", queries["id"].tolist()
    if entry.maps is None:
        dom = benchmark.resolve(needed(entry.dom, "map", scene))
        with readable(grid := home / "map.json", "not valid", kind=BenchmarkError, fix=_ANEW):
            prepared = dict(json.loads(read_text(grid, BenchmarkError, "grid of the map")))
        files = [(dom, benchmark.resolve(entry.dsm or ""), entry.dsm_sha256, prepared)]
    else:
        table, own = home / "maps.csv", benchmark.resolve(entry.maps)
        files = []
        for row in _read_rows(table, (*_GRID, "crs", "dsm_sha256"), ids).to_dict("records"):
            prepared = {"width": int(row["width"]), "height": int(row["height"])}
            prepared |= {"transform": [float(row[one]) for one in _GRID[2:]], "crs": row["crs"]}
            files.append((*photo_maps(own, row["id"]), str(row["dsm_sha256"]), prepared))
    maps = tuple(_open_map(*one) for one in files)
    rows = _read_rows(home / "crops.csv", CROP_COLUMNS, ids)
    crops = rows[list(CROP_COLUMNS)].to_numpy(np.int64)
    sizes = np.array([(one.dom.width, one.dom.height) for one in maps]).reshape(-1, 2)
    outside = (crops < (0, 0, 1, 1)).any(axis=1) | (crops[:, :2] + crops[:, 2:] > sizes).any(axis=1)
    refuse_cells(home / "crops.csv", "id", ids, outside, "windows inside the map")
    rest = entry.maps is not None, entry.truth_accuracy_m or 0.0
    return MatchingTruth(scene, queries, crops, maps, excluded, *rest)


def _read_rows(path: Path, columns: Sequence[str], ids: list[str]) -> pd.DataFrame:
    """Read a table that has a row for each query, in their order."""
    table = read_table(path, ("id", *columns))
    if table["id"].tolist() != ids:
        raise BenchmarkError("the rows are not those of queries.csv", where=path, fix=_ANEW)
    return table


def _open_map(
    dom: Path, dsm: Path, dsm_sha256: str | None, prepared: dict[str, Any]
) -> ReferenceMap:
    """Open a map with the grid and surface model that were prepared."""
    found = ReferenceMap(open_info(dom), dsm, dsm_sha256 or "")
    if prepared | {"crs": found.grid["crs"]} != found.grid:  # one CRS has several spellings
        what, fix = "the map has another grid than the prepared one", f"put it back, or {_ANEW}"
        what, expected = f"{what}: {json.dumps(found.grid)}", json.dumps(prepared)
        raise BenchmarkError(what, where=dom, expected=expected, fix=fix)
    check_same_crs(found.dom.crs, prepared.get("crs"), f"{dom} and the map that was prepared")
    if not ensure_file(dsm).is_file() or raster_sha256(dsm) != dsm_sha256:
        raise BenchmarkError(
            "the surface model is not there, or not the one that was prepared",
            where=dsm,
            expected=f"a raster with the SHA-256 {(dsm_sha256 or 'none')[:12]}…",
            fix=f"put it back with its side files (.aux.xml, .msk), or {_ANEW}",
        )
    return found


# --- made ---


def build_truth(inputs: SceneInputs, crop: Crop | None, prior: Prior) -> MatchingTruth:
    """Find the crop of each photo, or without a `crop` its own map; leave out photos without."""
    photos = inputs.photos if prior.is_measured else with_truth_as_prior(inputs.photos)
    if crop is None:
        windows, status, maps = _find_photo_maps(inputs)
    else:
        dom = needed(inputs.dom, "map", inputs.scene)
        dsm = needed(inputs.dsm, "surface model", inputs.scene)
        windows, status = _crops(photos, dom, dsm, crop, prior)
        maps = (ReferenceMap(dom, dsm, raster_sha256(dsm)),)
    cropped = status == CropStatus.CROPPED
    reasons = photos[["id", "image"]].assign(reason=[str(one) for one in status])[~cropped]
    excluded = with_unposed(reasons.reset_index(drop=True), inputs)
    queries = photos[cropped].reset_index(drop=True)
    return MatchingTruth(inputs.scene, queries, windows[cropped], maps, excluded, crop is None)


def _find_photo_maps(inputs: SceneInputs) -> tuple[Ints, NDArray[Any], tuple[ReferenceMap, ...]]:
    folder = needed(inputs.maps, "folder of maps", inputs.scene)
    files = [photo_maps(folder, photo) for photo in inputs.photos["id"]]
    there = np.array([dom.is_file() and dsm.is_file() for dom, dsm in files], np.bool_)
    present = [files[row] for row in np.flatnonzero(there)]
    maps = tuple(ReferenceMap(open_info(dom), dsm, raster_sha256(dsm)) for dom, dsm in present)
    windows = np.zeros((len(files), 4), np.int64)
    windows[there, 2:] = np.reshape([(one.dom.width, one.dom.height) for one in maps], (-1, 2))
    return windows, np.where(there, CropStatus.CROPPED, CropStatus.NO_MAP), maps


def _crops(
    photos: pd.DataFrame, dom: RasterInfo, dsm: Path, crop: Crop, prior: Prior
) -> tuple[Ints, NDArray[Any]]:
    there = np.isfinite(photos[list(PRIOR_COLUMNS)].to_numpy(np.float64)).all(axis=1)
    cameras, priors = cameras_of(photos[there]), poses_of(photos[there], PRIOR_COLUMNS)
    # Not number by number: a pose has two quaternions, and metadata are rounded. Not every photo:
    # one that was moved would hide all the others.
    same = count_near(poses_of(photos[there]), priors, _SAME_M, _SAME_DEG)
    if prior.is_measured and 2 * same > len(priors):
        raise BenchmarkError(
            f"the prior poses equal the ground truth in {same} of {len(priors)} photos "
            f"(to {_SAME_M * 100:g} cm and {_SAME_DEG:g} degrees)",
            expected="priors from the photos' own metadata",
            fix="a protocol that means this says prior.source = 'truth'",
        )
    windows = np.zeros((len(photos), 4), np.int64)
    status = np.full(len(photos), CropStatus.NO_PRIOR, object)
    with blocked_heights(dsm) as field:
        windows[there], status[there] = crop_windows(cameras, priors, dom, field, crop)
    return windows, status


def crop_windows(
    cameras: Cameras, priors: Poses, dom: RasterInfo, field: HeightField, crop: Crop
) -> tuple[Ints, NDArray[np.str_]]:
    """Find the reference crops (N, 4) of N queries, zero where there is none, and their status."""
    # Rays of the image's corners end on the ground, or at the range.
    directions = rays_to_world(priors, back_project(cameras, anchor_pixels(cameras, 0.0)))
    centres, far = priors.centres, crop.max_range_m
    ends = centres[:, None] + far * directions
    height_at = NearestHeights(field, crop.nearest_of_px)
    for start in range(0, len(cameras), _CAMERAS):
        part = slice(start, start + _CAMERAS)
        hits = intersect_heightfield(centres[part], directions[part], field, far)
        points = meet_missing(centres[part], directions[part], hits, field, height_at, far)
        ends[part] = np.where(np.isnan(points), ends[part], points)
    pixels = to_map_pixels(field.crs, dom)(ends[..., :2])
    low, high = np.fmin.reduce(pixels, axis=1), np.fmax.reduce(pixels, axis=1)
    grown = crop.margin * (high - low)
    blind = np.isnan(grown).any(axis=1)
    size = (dom.width, dom.height)
    first = np.floor(np.round(low - grown, _DECIMALS))
    # Rays of a level camera, all cut, end on one line: it has a pixel nevertheless.
    last = np.maximum(np.ceil(np.round(high + grown, _DECIMALS)), first + 1)
    first, last = np.clip(first, 0, size), np.clip(last, 0, size)
    on_map = (last > first).all(axis=1)
    windows = np.where(on_map[:, None], np.hstack((first, last - first)), 0).astype(np.int64)
    status = np.select((on_map, blind), (CropStatus.CROPPED, CropStatus.NO_RAY), CropStatus.OFF_MAP)
    return windows, status


def write_crop(
    dom_path: str | Path, dsm_path: str | Path, window: PixelWindow, folder: Path, name: str
) -> tuple[Path, Path]:
    """Write the crop of map and surface model, ``<name>_dom.tif`` and ``<name>_dsm.tif``."""
    dom, dsm = open_info(dom_path), open_info(dsm_path)
    targets = folder / f"{name}_dom.tif", folder / f"{name}_dsm.tif"
    below = _window_below(window, dom, dsm)
    layout = {"tiled": True, "blockxsize": 256, "blockysize": 256, "bigtiff": "if_safer"}
    for source, part, target in zip((dom, dsm), (window, below), targets, strict=True):
        # The mask goes into the file: a separate one would not be moved with it.
        internal = rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True)
        with open_raster(source.path) as dataset, internal, MemoryFile() as memory:
            cut = f"vrt://{dataset.name}?srcwin={','.join(map(str, part))}"
            rasterio.shutil.copy(cut, memory.name, driver="GTiff", compress="deflate", **layout)
            with atomic_write(target) as stream:
                stream.write(memory.getbuffer())
    return targets


def _window_below(window: PixelWindow, dom: RasterInfo, dsm: RasterInfo) -> PixelWindow:
    """Return the window of the surface model that covers a window of the map and a pixel more."""
    x, y, width, height = window
    share = np.linspace(0.0, 1.0, _SIDE_POINTS)
    column, row = np.meshgrid(x + width * share, y + height * share)
    world = pixel_to_world(dom.transform, np.stack((column, row), axis=-1).reshape(-1, 2))
    pixels = world_to_pixel(dsm.transform, change_of_plane(dom.crs, dsm.crs)(world))
    size = (dsm.width, dsm.height)
    low = np.clip(np.floor(np.fmin.reduce(pixels)) - 1, 0, size)
    high = np.clip(np.ceil(np.fmax.reduce(pixels)) + 1, 0, size)
    if not (high > low).all():
        what = f"the surface model does not meet the window {window} of the map"
        raise RasterError(what, where=dsm.path, expected=f"a raster that covers {dom.path}")
    return tuple(np.concatenate((low, high - low)).astype(int).tolist())
