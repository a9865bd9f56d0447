"""Reading AirZoo's frames: tables of poses, and true clouds out of depth."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, CameraError, UsageError, counted, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.validation import SAFE_NAME
from airzoo_bench.datasets.mini.frames import ECEF_COLUMNS, PLACE_COLUMNS
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.native_tables import NativeTable, read_table
from airzoo_bench.datasets.posed_photos import PosedPhotos, check_centred
from airzoo_bench.datasets.published.depth_clouds import DepthFrames
from airzoo_bench.datasets.published.options import AIRZOO_TEST_NAME
from airzoo_bench.datasets.published.places import folder_content, name_order
from airzoo_bench.datasets.published.reconstructions import (
    chosen_photos,
    photos_by_stem,
    published_scenes,
    reconstruction_protocol,
    stem_of,
)
from airzoo_bench.geometry.arrays import Floats, multiply
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS, ecef_to_geodetic, enu_axes, geodetic_to_ecef
from airzoo_bench.geometry.poses import (
    Poses,
    angles_to_rotations,
    quaternion_to_matrix,
    rotation_angle_deg,
)
from airzoo_bench.protocol.lookup import protocol_for
from airzoo_bench.protocol.model import ProtocolScene
from airzoo_bench.reconstruction.settings import ReconstructionProtocol

if TYPE_CHECKING:
    from airzoo_bench.datasets.published.options import AirZooTestOptions

__all__ = ["find_trajectories", "read_trajectory", "trajectory_protocol"]

_TABLE = "frames.csv"
_LAYOUT = "a folder for each trajectory, with frames.csv, images/ and depth/"
_LENS = ("width", "height", "fx", "fy", "cx", "cy")
_DISTORTION = ("k1", "k2", "p1", "p2", "k3")
_CONDITIONS = ("weather", "time_of_day")
_OPTIONAL = (*PLACE_COLUMNS, *ECEF_COLUMNS, *_DISTORTION, *_CONDITIONS)
# Two statements of one pose that are farther apart are of other frames or axes.
_APART_M, _APART_DEG = 1.0, 1.0


def find_trajectories(source: Path, *, published: bool) -> dict[str, Path]:
    """Return the folders of trajectories by scene id, in the order of their names: 2 before 10."""
    patterns = (_TABLE, f"*/{_TABLE}", f"*/*/{_TABLE}")
    tables = [path for pattern in patterns for path in sorted(source.glob(pattern))]
    folders = sorted((path.resolve().parent for path in tables), key=name_order)
    if not folders:
        raise BenchmarkError(
            f"holds no trajectory: {folder_content(source)}",
            where=source,
            expected=_LAYOUT,
            fix="write a table of frames for each trajectory, as docs/airzoo-mini.md describes it: "
            "the layout of AirZoo's own archives is not known here",
        )
    names = [folder.name for folder in folders]
    odd = [name for name in names if names.count(name) > 1 or not re.match(SAFE_NAME, name)]
    if odd and not published:
        raise BenchmarkError(
            f"folders whose names cannot be scenes, or are there twice: {first_of(odd)}",
            where=source,
            expected="letters, digits, '.', '_' and '-', at most 64, each once",
            fix="rename these folders",
        )
    if not published:
        return dict(zip(names, folders, strict=True))
    ids = published_scenes(AIRZOO_TEST_NAME)
    if len(folders) != len(ids):
        raise BenchmarkError(
            f"holds {counted(len(folders), 'trajectory')}, not {len(ids)}: {first_of(names)}",
            where=source,
            expected=f"the {len(ids)} trajectories of AirZoo-Test, which are numbered by name",
            fix="complete the download; or --name OTHER for a benchmark of what is there",
        )
    return dict(zip(ids, folders, strict=True))


def trajectory_protocol(options: AirZooTestOptions, root: Path) -> ReconstructionProtocol:
    """Return the shipped protocol; for a benchmark of another name, one of its trajectories."""
    shipped = reconstruction_protocol(AIRZOO_TEST_NAME, root)
    if options.name == AIRZOO_TEST_NAME:
        return shipped
    if not re.match(SAFE_NAME, options.name):
        raise UsageError(
            f"--name {options.name[:80]!r} cannot be the name of a benchmark",
            expected="letters, digits, '.', '_' and '-', at most 64",
        )
    found = find_trajectories(options.source, published=False)
    scenes = tuple(ProtocolScene(id=name, title=name) for name in found)
    protocol = protocol_for(shipped, options.name, {})
    return protocol.model_copy(update={"scenes": scenes})


def read_trajectory(options: AirZooTestOptions, scene: str, progress: Progress) -> NativeScene:
    """Read a trajectory in a local frame of east, north and up, and make its true cloud."""
    folder = find_trajectories(options.source, published=options.name == AIRZOO_TEST_NAME)[scene]
    table = read_table(folder / _TABLE, ("name", *_LENS, *_OPTIONAL), optional=_OPTIONAL)
    table.require_unique("name")
    photos = photos_by_stem(folder / "images", _LAYOUT)
    images = _images(table, photos)
    rows, notes = chosen_photos(range(len(table)), options.every)
    names = tuple(images[row] for row in rows)
    sizes = [photo_size(folder / "images" / name) for name in progress(names, scene, len(names))]
    cameras = _cameras(table, rows, sizes)
    centres, rotations = _ecef_poses(table)
    poses, place = _local(centres, rotations, rows, names)
    check_centred(PosedPhotos(names, cameras, poses, None), table.path)
    cloud = _frames(folder, names, cameras, poses, options).cloud(
        options.clouds or options.source, scene, progress
    )
    own = "" if folder.name == scene else f"is the trajectory {folder.name}; "
    frame = f"{own}its frame is east, north and up about {place}"
    taken = set(images)
    return NativeScene(
        scene,
        folder / "images",
        names,
        cameras,
        poses,
        LOCAL_CRS,
        cloud=cloud,
        poses_from=table.path,
        conditions={
            column: [table.texts(column)[row] for row in rows]
            for column in _CONDITIONS
            if column in table.columns
        },
        unposed=tuple(name for name in photos.values() if name not in taken),
        notes=(*notes, frame),
    )


def _images(table: NativeTable, photos: dict[str, str]) -> list[str]:
    """Return the photo of each row."""
    missing = [name for name in table.texts("name") if stem_of(name) not in photos]
    if missing or not len(table):
        raise BenchmarkError(
            f"names photos that are not there: {first_of(missing, len(table))}"
            if missing
            else "names no frame",
            where=table.path,
            expected="a row for each photo of images/, by its name without the ending",
            fix="complete the download",
        )
    return [photos[stem_of(name)] for name in table.texts("name")]


def _cameras(table: NativeTable, rows: Sequence[int], sizes: Sequence[tuple[int, int]]) -> Cameras:
    values = {name: table.numbers(name)[list(rows)] for name in _LENS}
    bent = [
        table.numbers(name)[list(rows)] if name in table.columns else np.zeros(len(rows))
        for name in _DISTORTION
    ]
    names = [table.texts("name")[row] for row in rows]
    stated = np.stack([values["width"], values["height"]], axis=1)
    other = [name for name, bad in zip(names, (stated != sizes).any(axis=1), strict=True) if bad]
    if other:
        raise CameraError(
            f"photos of another size than stated: {first_of(other, len(names))}", where=table.path
        )
    matrices = np.zeros((len(rows), 3, 3))
    matrices[:, 0, 0], matrices[:, 1, 1], matrices[:, 2, 2] = values["fx"], values["fy"], 1.0
    matrices[:, 0, 2], matrices[:, 1, 2] = values["cx"], values["cy"]
    try:
        width, height = stated.T
        return Cameras.from_matrices(matrices, width, height, np.stack(bent, axis=1), names=names)
    except CameraError as error:
        raise error.inside(table.path) from error


def _ecef_poses(table: NativeTable) -> tuple[Floats, Floats]:
    """Return centres (N, 3) and rotations (N, 3, 3) from ECEF, as the table states them."""
    stated = [all(name in table.columns for name in part) for part in (ECEF_COLUMNS, PLACE_COLUMNS)]
    if not any(stated):
        raise BenchmarkError(
            f"has the columns {', '.join(table.columns)}",
            where=table.path,
            expected=f"{', '.join(ECEF_COLUMNS)}; or {', '.join(PLACE_COLUMNS)}",
        )
    found = [
        how(table) for how, there in zip((_from_ecef, _from_wgs84), stated, strict=True) if there
    ]
    if len(found) == 2:
        _check_agreement(table, *found)
    return found[0]


def _from_ecef(table: NativeTable) -> tuple[Floats, Floats]:
    x, y, z, *quaternion = (table.numbers(name) for name in ECEF_COLUMNS)
    names = table.texts("name")
    try:
        return np.stack([x, y, z], axis=1), quaternion_to_matrix(np.stack(quaternion, 1), names)
    except CameraError as error:
        raise error.inside(table.path) from error


def _from_wgs84(table: NativeTable) -> tuple[Floats, Floats]:
    limits = {"longitude": 180.0, "latitude": 90.0}
    values = [table.numbers(n, -limits.get(n, 1e6), limits.get(n, 1e6)) for n in PLACE_COLUMNS]
    place, (roll, pitch, yaw) = np.stack(values[:3], axis=1), values[3:]
    local = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    ecef_to_enu = np.swapaxes(enu_axes(place[:, :2]), -1, -2)
    return geodetic_to_ecef(place), multiply(local, ecef_to_enu)


def _check_agreement(
    table: NativeTable, ecef: tuple[Floats, Floats], wgs84: tuple[Floats, Floats]
) -> None:
    apart = np.sqrt(((ecef[0] - wgs84[0]) ** 2).sum(axis=1))
    turned = rotation_angle_deg(ecef[1], wgs84[1])
    bad = (apart > _APART_M) | (turned > _APART_DEG)
    if bad.any():
        named = [name for name, wrong in zip(table.texts("name"), bad, strict=True) if wrong]
        raise CameraError(
            f"poses in ECEF and in WGS84 contradict: {first_of(named, len(table))}; they are up to "
            f"{apart.max():.1f} m and {turned.max():.1f} degrees apart",
            where=table.path,
            expected="one pose, world-to-camera with OpenCV axes, and DJI's yaw, pitch and roll",
            fix="correct one of them, or leave out its columns",
        )


def _local(
    centres: Floats, rotations: Floats, rows: Sequence[int], names: Sequence[str]
) -> tuple[Poses, str]:
    """Return the chosen poses in east, north, up about the middle of all, and where that is."""
    middle = np.round(ecef_to_geodetic(centres.mean(axis=0))[:2], 5)
    if not np.isfinite(middle).all():
        raise CameraError("positions in ECEF are far from the earth", expected="metres")
    to_enu = enu_axes(middle[None])[0].T
    origin = geodetic_to_ecef((*middle, 0.0))
    moved: Floats = (centres[list(rows)] - origin) @ to_enu.T
    turned: Floats = rotations[list(rows)] @ to_enu.T
    return Poses.from_centres(turned, moved, names), f"({middle[0]:.5f}, {middle[1]:.5f})"


def _frames(
    folder: Path, names: tuple[str, ...], cameras: Cameras, poses: Poses, options: AirZooTestOptions
) -> DepthFrames:
    protocol = reconstruction_protocol(AIRZOO_TEST_NAME, Path())
    voxel = protocol.preparation.voxel_m
    return DepthFrames(
        folder / "depth",
        names,
        cameras,
        poses.rounded(),
        options.depth_kind == "ray",
        options.depth_scale,
        protocol.fusion.max_depth_m,
        0.5 if voxel == "none" else voxel,
    )
