"""AirZoo-Test, and AirZoo's own frames: rendered photos with exact depth and poses.

A trajectory is a folder with ``frames.csv``, ``images/`` and ``depth/``, as docs/airzoo-mini.md
describes it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, first_of, readable
from airzoo_bench.core.files import data_root, fingerprint
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.validation import SAFE_NAME
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.cameras import stated_cameras
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.depth_maps import find_depths, read_depth
from airzoo_bench.datasets.mini.renderer import PLACE_COLUMNS
from airzoo_bench.datasets.published.places import (
    chosen_photos,
    files_by_key,
    missing,
    published_scenes,
    stem_of,
)
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos, check_centred
from airzoo_bench.datasets.settings import AirZooTestOptions
from airzoo_bench.datasets.tables import Table, read_table
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.arrays import Floats, multiply
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS, ecef_to_geodetic, enu_axes, geodetic_to_ecef
from airzoo_bench.geometry.poses import (
    Poses,
    angles_to_rotations,
    depth_to_points,
    quaternion_to_matrix,
)
from airzoo_bench.protocol.model import ProtocolScene, protocol_for, protocol_of_track
from airzoo_bench.reconstruction.clouds import VoxelGrid, grid_origin
from airzoo_bench.reconstruction.settings import ReconstructionProtocol

_NAME, _TABLE = "airzoo-test", "frames.csv"
_LAYOUT = "a folder for each trajectory, with frames.csv, images/ and depth/"
_LENS = ("width", "height", "fx", "fy", "cx", "cy")
_ECEF = ("ecef_x", "ecef_y", "ecef_z", "ecef_qw", "ecef_qx", "ecef_qy", "ecef_qz")
_DISTORTION = ("k1", "k2", "p1", "p2", "k3")
_CONDITIONS = ("weather", "time_of_day")
_OPTIONAL = (*PLACE_COLUMNS, *_ECEF, *_DISTORTION, *_CONDITIONS)
_DECIMALS = 4


class _AirZooTest(Dataset[AirZooTestOptions]):
    """Trajectories of AirZoo."""

    name = _NAME
    about = load_about("airzoo-test")
    options = AirZooTestOptions

    def benchmark_protocols(self, options: AirZooTestOptions, root: Path) -> BenchmarkProtocols:
        shipped = _protocol(root)
        if options.name == _NAME:
            return BenchmarkProtocols((shipped,))
        scenes = tuple(ProtocolScene(id=name, title=name) for name in self.scenes(options))
        protocol = protocol_for(shipped, options.name, {})
        return BenchmarkProtocols((protocol.model_copy(update={"scenes": scenes}),))

    def scenes(self, options: AirZooTestOptions) -> Mapping[str, Sequence[Path]]:
        tables = [p for depth in ("", "*/", "*/*/") for p in options.source.glob(depth + _TABLE)]
        folders = sorted((path.resolve().parent for path in tables), key=_name_order)
        ids = [folder.name for folder in folders]
        expected = f"{_LAYOUT}; names of letters, digits, '.', '_' and '-', each once"
        if options.name == _NAME:
            ids = published_scenes(f"{_NAME}-reconstruction")
            expected = f"the {len(ids)} trajectories of AirZoo-Test, which are numbered by name"
        sound = all(re.match(SAFE_NAME, name) for name in ids)
        if not sound or not folders or not len(folders) == len(ids) == len({*ids}):
            raise missing(
                f"holds {len(folders)} trajectories",
                options.source,
                expected,
                "complete the download; or --name OTHER for a benchmark of what is there",
            )
        return {one: [folder] for one, folder in zip(ids, folders, strict=True)}

    def read(self, options: AirZooTestOptions, scene: str, progress: Progress) -> NativeScene:
        folder = self.scenes(options)[scene][0]
        columns = {name: (name,) for name in ("name", *_LENS, *_OPTIONAL)}
        table = read_table(folder / _TABLE, columns, _OPTIONAL)
        table.require_unique("name")
        photos = files_by_key(folder / "images", stem_of, _LAYOUT)
        expected = "a row for each photo of images/, its pose and a camera of its size"
        with readable(table.path, "cannot be read", kind=BenchmarkError, expected=expected):
            images = [photos[stem_of(name)] for name in table.texts("name")]
            rows, notes = chosen_photos(range(len(table)), options.every)
            names = tuple(images[row] for row in rows)
            shown = progress(names, scene, len(names))
            sizes = {name: photo_size(folder / "images" / name) for name in shown}
            keys = [key for key in (*_LENS, *_DISTORTION) if table.has(key)]
            lenses = table.columns(keys)[rows].tolist()
            values = {
                name: dict(zip(keys, lens, strict=True))
                for name, lens in zip(names, lenses, strict=True)
            }
            cameras = stated_cameras(values, sizes, folder / "images", table.path)
            poses, place = _local(*_ecef_poses(table), rows, names)
        posed = PosedPhotos(names, cameras, poses, LOCAL_CRS)
        check_centred(posed, table.path)
        cloud = _cloud(folder / "depth", names, cameras, poses.rounded(), options, scene, progress)
        own = "" if folder.name == scene else f"is the trajectory {folder.name}; "
        return NativeScene(
            scene,
            folder / "images",
            *posed,
            cloud=cloud,
            poses_from=table.path,
            conditions={
                column: [table.texts(column)[row] for row in rows]
                for column in _CONDITIONS
                if table.has(column)
            },
            unposed=tuple(sorted(set(photos.values()) - set(images))),
            notes=(*notes, f"{own}its frame is east, north and up about {place}"),
        )


def _protocol(root: Path) -> ReconstructionProtocol:
    return protocol_of_track(f"{_NAME}-reconstruction", root, ReconstructionProtocol)


def _name_order(path: Path) -> list[tuple[str, int]]:
    """Return what sorts names with the numbers in them as numbers: 2 before 10."""
    return [(text, int(n or 0)) for text, n in re.findall(r"([^0-9]*)([0-9]*)", path.name)]


def _ecef_poses(table: Table) -> tuple[Floats, Floats]:
    """Return centres (N, 3) and rotations (N, 3, 3) from ECEF, or as WGS84 states them."""
    if table.has(*_ECEF):
        values = table.columns(_ECEF)
        return values[:, :3], quaternion_to_matrix(values[:, 3:], table.texts("name"))
    if not table.has(*PLACE_COLUMNS):
        raise ValueError(f"it needs {', '.join(_ECEF)}; or {', '.join(PLACE_COLUMNS)}")
    limits = {"longitude": 180.0, "latitude": 90.0}
    stated = [table.numbers(n, -limits.get(n, 1e6), limits.get(n, 1e6)) for n in PLACE_COLUMNS]
    place, (roll, pitch, yaw) = np.stack(stated[:3], axis=1), stated[3:]
    local = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    ecef_to_enu = np.swapaxes(enu_axes(place[:, :2]), -1, -2)
    return geodetic_to_ecef(place), multiply(local, ecef_to_enu)


def _local(
    centres: Floats, rotations: Floats, rows: Sequence[int], names: Sequence[str]
) -> tuple[Poses, str]:
    """Return the chosen poses in east, north, up about the middle of all, and where that is."""
    middle = np.round(ecef_to_geodetic(centres.mean(axis=0))[:2], 5)
    if not np.isfinite(middle).all():
        raise ValueError("positions in ECEF are far from the earth")
    to_enu = enu_axes(middle[None])[0].T
    origin = geodetic_to_ecef((*middle, 0.0))
    moved: Floats = (centres[rows] - origin) @ to_enu.T
    turned: Floats = rotations[rows] @ to_enu.T
    return Poses.from_centres(turned, moved, names), f"({middle[0]:.5f}, {middle[1]:.5f})"


def _cloud(
    folder: Path,
    names: tuple[str, ...],
    cameras: Cameras,
    poses: Poses,
    options: AirZooTestOptions,
    label: str,
    progress: Progress,
) -> Path:
    """Make the true cloud from depth maps, unless one of the same frames is kept."""
    protocol = _protocol(Path())
    stated, most_m = protocol.preparation.voxel_m, protocol.fusion.max_depth_m
    voxel = 0.5 if stated == "none" else stated
    found = find_depths(folder, names)
    paths = [path for path in found if path is not None]
    if len(paths) < len(names):
        absent = [name for name, path in zip(names, found, strict=True) if path is None]
        what = f"photos without a depth map ({first_of(absent, len(names))})"
        raise missing(what, folder, _LAYOUT)
    arrays = (*vars(cameras).values(), poses.rotation, poses.centres)
    key = fingerprint(
        [
            [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in paths],
            [np.asarray(array).tolist() for array in arrays],
            [options.depth_kind, options.depth_scale, most_m, voxel],
        ]
    )
    kept = data_root() / "made" / _NAME / f"{label}-{key[:16]}.ply"
    if kept.is_file():
        return kept
    grid = VoxelGrid(voxel, grid_origin(voxel))
    for row, path in progress(enumerate(paths), f"{label}, true cloud", len(paths)):
        camera, pose = cameras.take(row), poses.take(row)
        width, height = int(camera.width[0]), int(camera.height[0])
        depth = read_depth(path, width, height, options.depth_scale).astype(np.float64)
        near, along = depth <= most_m, options.depth_kind == "ray"  # NaN where there is none
        points = depth_to_points(depth, near, camera, pose, along_ray=along)
        grid.add(points[np.isfinite(points).all(axis=1)])
    points = grid.points()
    kept.parent.mkdir(parents=True, exist_ok=True)
    write_ply(kept, Cloud(np.round(points, _DECIMALS) + 0.0))
    return kept


AIRZOO_TEST = _AirZooTest()
