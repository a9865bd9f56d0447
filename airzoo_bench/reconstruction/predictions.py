"""Predictions of the reconstruction track: a folder or an archive with an entry a scene.

An entry is ``school.ply`` or ``school/cloud.ply``, a cloud or a mesh, with its cameras in
``school.cameras.npz`` or ``school/cameras.npz``; or ``school.npz``, maps with cameras. A file alone
is a prediction of one scene. Readers list files as methods write them as `ScenePredictions`, too.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError, PredictionError, UnreadableError, first_of
from airzoo_bench.core.validation import SAFE_NAME
from airzoo_bench.evaluation.predictions import FIX_READER
from airzoo_bench.evaluation.track import ScenePredictions
from airzoo_bench.formats.archives import Bundle, Member, open_bundle
from airzoo_bench.formats.arrays import Arrays, check_fields, numbers, open_arrays, texts
from airzoo_bench.formats.clouds import KINDS, SUFFIXES
from airzoo_bench.formats.clouds.cloud import FileCloud, MeshSampling, open_cloud
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import FARTHEST, Poses, check_rotations
from airzoo_bench.geometry.precision import pose_errors_m
from airzoo_bench.reconstruction.checks import check_resolution
from airzoo_bench.reconstruction.fusion import DepthMaps, PointMaps

_UNPACKED_BYTES = 1 << 40
_PROTOCOL, _CAMERAS = "protocol.txt", "cameras.npz"
_ENTRY = re.compile(
    r"(?P<scene>[^/]+?)(?:[./](?P<cameras>cameras\.npz)|(?:/[^/]+)?"
    rf"(?:{'|'.join(map(re.escape, SUFFIXES))}))",
    re.IGNORECASE,
)
_MAPS = {"depth": ("N", "H", "W"), "world_points": ("N", "H", "W", "3")}
_MAPS["points"] = _MAPS["world_points"]
_CONFIDENCE, _COLOURS = ("conf", "confidence"), ("colours", "colors", "image")
_CAMERAS_OF = ("intrinsics", "extrinsics", "image_names")
_HALF_A_PIXEL = {"half": 0.0, "integer": 0.5}
_BYTES_A_PIXEL = 96  # depth and surface in double precision, their places, rays and points
_ROW_TOLERANCE = 1e-6
_POSES = "image_names (N,) and extrinsics (N, 3, 4) or (N, 4, 4), world-to-camera"
_EXPECTED = (
    "depth (N, H, W) or world_points (N, H, W, 3), intrinsics (N, 3, 3), extrinsics (N, 3, 4) or "
    "(N, 4, 4) world-to-camera, image_names (N,), and perhaps conf (N, H, W), colours (N, H, W, "
    "3), pixel_centres ('half' or 'integer')"
)


@dataclass(frozen=True, eq=False)
class ImagePoses:
    """Poses of N images by their names, which are numbers unless the file `has_names`.

    `poses` have no meaning where an image is not `posed`. `errors` estimate by how much digits that
    the file lacks have moved each camera, in the unit of its translation.
    """

    names: NDArray[np.str_]
    posed: Bools
    poses: Poses
    errors: Floats
    has_names: bool = True


@dataclass(frozen=True, eq=False)
class ScenePrediction:
    """The prediction of a scene, opened; depth maps of views without a pose are among the geometry.

    `images` are of the views themselves, or from a file of cameras. `pixel_centres` are what the
    file states, ``half`` or ``integer``; where it does not, they are taken to be ``half`` where
    images are named, ``integer`` where they are not.
    """

    geometry: FileCloud | DepthMaps | PointMaps
    images: ImagePoses | None
    notes: tuple[str, ...] = ()
    pixel_centres: str | None = None

    @property
    def kind(self) -> str:
        """``cloud``, ``mesh``, ``depth`` or ``points``."""
        if isinstance(self.geometry, FileCloud):
            return "mesh" if self.geometry.kind.endswith("mesh") else "cloud"
        return "depth" if isinstance(self.geometry, DepthMaps) else "points"


@contextmanager
def _open_entry(
    bundle: Bundle,
    geometry: Member,
    cameras: Member | None,
    limit_bytes: int,
    sampling: MeshSampling | None,
) -> Iterator[ScenePrediction]:
    """Open a cloud or maps, and perhaps cameras, of a folder or an archive."""
    images = None
    with ExitStack() as stack:
        if cameras is not None:
            arrays = open_arrays(stack.enter_context(bundle.file(cameras)), limit_bytes)
            check_fields(arrays, ("image_names", "extrinsics"), ("protocol", *_CAMERAS_OF), _POSES)
            images = read_image_poses(arrays, len(texts(arrays, "image_names", 1)))
        path = stack.enter_context(bundle.file(geometry))
        if path.suffix.lower() != ".npz" or not _holds_maps(open_arrays(path, limit_bytes)):
            cloud = open_cloud(path, limit_bytes=limit_bytes, sampling=sampling)
            yield ScenePrediction(cloud, images, cloud.notes)
            return
        views = read_maps(open_arrays(path, limit_bytes))
        if views.images is not None and cameras is not None:
            where = f"{bundle.path}, {geometry.name}"
            raise PredictionError(f"holds extrinsics, and so does {cameras.name}", where=where)
        yield replace(views, images=views.images or images)


# --- listing ---


def open_reconstruction(path: Path) -> ScenePredictions:
    """List what a prediction holds: a folder, a zip archive, or one file of a scene."""
    if path.is_file() and path.name.lower().endswith(SUFFIXES):
        member = Member(path.name, path.stat().st_size)
        bundle = Bundle(path.parent, (member,))
        return ScenePredictions(path, {path.stem: partial(_open_entry, bundle, member, None)})
    bundle = open_bundle(path, _UNPACKED_BYTES)
    wrapper, protocol, extra_files = _outer_folder(bundle.members), None, []
    members: dict[str, dict[str, Member]] = {"geometry": {}, "cameras": {}}
    for member in bundle.members:
        name = member.name.removeprefix(wrapper)
        scene, kind = _parse_entry(name)
        if name == _PROTOCOL:
            protocol = _protocol_name(bundle, member)
        elif not kind:
            extra_files.append(name)
        elif members[kind].setdefault(scene, member) is not member:
            both = f"{members[kind][scene].name} and {member.name}"
            raise PredictionError(f"scene {scene!r} has two entries: {both}", where=path)
    geometry, cameras = members.values()
    extra_files += [one.name for scene, one in cameras.items() if scene not in geometry]
    if not geometry:
        expected = f"an entry a scene, such as school.ply or school/cloud.ply; endings {KINDS}"
        others = f", but {first_of(extra_files, noun='other file')}" if extra_files else ""
        what = f"holds no cloud, mesh or npz{others}"
        raise UnreadableError(what, where=path, expected=expected, fix=FIX_READER)
    pairs = {scene: (one, cameras.get(scene)) for scene, one in geometry.items()}
    entries = {scene: partial(_open_entry, bundle, *pair) for scene, pair in pairs.items()}
    return ScenePredictions(path, entries, tuple(extra_files), protocol)


def _outer_folder(members: tuple[Member, ...]) -> str:
    """Return the folder, with its slash, that holds everything and is no scene; or nothing."""
    prefix = members[0].name.partition("/")[0] + "/" if members else ""
    if not all(member.name.startswith(prefix) for member in members):
        return ""
    inside = [member.name.removeprefix(prefix) for member in members]
    clouds = [name for name in inside if _parse_entry(name)[1] == "geometry" and name != _CAMERAS]
    is_scene = len(clouds) == 1 and "/" not in clouds[0] and _PROTOCOL not in inside
    return "" if is_scene else prefix


def _parse_entry(name: str) -> tuple[str, str]:
    """Return the scene that a file belongs to, and whether it is its geometry or its cameras."""
    match = _ENTRY.fullmatch(name)
    if match is None or name == _PROTOCOL:
        return "", ""
    return match["scene"], "cameras" if match["cameras"] else "geometry"


def _protocol_name(bundle: Bundle, member: Member) -> str:
    name = bundle.text(member, 1024).strip()
    # A file from a stranger must not choose which file of this computer is read.
    if not re.fullmatch(SAFE_NAME, name) or name.endswith(".toml"):
        where = f"{bundle.path}, {member.name}"
        raise PredictionError(f"{name[:80]!r} is no protocol's name", where=where)
    return name


# --- maps and cameras ---


def _holds_maps(arrays: Arrays) -> bool:
    """Say whether an npz holds depth maps or point maps; else it is a cloud."""
    names = arrays.names()
    cloud = "points" in names and not names & {"depth", "world_points", *_CAMERAS_OF}
    return not cloud or arrays.map("points").ndim == 4


def read_maps(arrays: Arrays) -> ScenePrediction:
    """Take depth or point maps and their cameras, named as the suite's own files name them."""
    names = arrays.names()
    kind = next((name for name in _MAPS if name in names), "depth")
    trust = next((name for name in _CONFIDENCE if name in names), "conf")
    needed = (kind, "intrinsics", "extrinsics") if kind == "depth" else (kind,)
    allowed = ("protocol", "pixel_centres", kind, *_CAMERAS_OF, trust, *_COLOURS)
    check_fields(arrays, needed, allowed, _EXPECTED)
    maps = _read_values(arrays, kind)
    stated = None
    if "pixel_centres" in names:
        stated = "".join(map(str, arrays.read("pixel_centres").reshape(-1)[:2]))
        if stated not in _HALF_A_PIXEL:
            expected = "'half' (the first pixel's centre is (0.5, 0.5)) or 'integer' ((0, 0))"
            raise _fault(arrays, f"says {stated[:20]!r}", "pixel_centres", expected)
    shift = _HALF_A_PIXEL[stated or ("half" if "image_names" in names else "integer")]
    pixels = maps.shape[1] * maps.shape[2]
    arrays.budget.hold(arrays.path, f"working on views of {pixels:,} px", pixels * _BYTES_A_PIXEL)
    cameras = _read_cameras(arrays, maps.shape, shift)
    images = read_image_poses(arrays, len(maps)) if "extrinsics" in names else None
    confidence = arrays.map(trust) if trust in names else None
    if confidence is not None and (
        confidence.shape != maps.shape[:3] or confidence.dtype.kind not in "biuf"
    ):
        what = f"is {confidence.dtype} of shape {confidence.shape}"
        raise _fault(arrays, what, trust, f"numbers of shape {maps.shape[:3]}, that of the maps")
    geometry: DepthMaps | PointMaps = PointMaps(maps, confidence)
    if kind == "depth" and cameras is not None and images is not None:
        geometry = DepthMaps(maps, cameras, images.poses, confidence)
    return ScenePrediction(geometry, images, pixel_centres=stated)


def _fault(
    arrays: Arrays, what: str, field: str, expected: str | None, fix: str | None = None
) -> PredictionError:
    """Make the error of a field."""
    where = f"{arrays.path}, field '{field}'"
    return PredictionError(what, where=where, expected=expected, fix=fix)


def _read_values(arrays: Arrays, name: str) -> NDArray[Any]:
    values = arrays.map(name)
    if name == "depth" and values.ndim == 4 and values.shape[-1] == 1:
        values = values[..., 0]
    shape = _MAPS[name]
    fits = values.ndim == len(shape) and values.shape[3:] in ((), (3,)) and 0 not in values.shape
    if values.dtype.kind != "f" or values.dtype.itemsize > 8 or not fits:
        fix = f"{name}.astype(np.float32), in the units of the poses"
        if values.dtype.kind in "iu":
            fix += "; whole numbers are often millimetres, / 1000"
        what = f"is {values.dtype} of shape {values.shape}"
        raise _fault(arrays, what, name, f"floating point ({', '.join(shape)})", fix)
    return values


def _read_cameras(arrays: Arrays, shape: tuple[int, ...], shift: float) -> Cameras | None:
    if "intrinsics" not in arrays.names():
        return None
    matrices = numbers(arrays, "intrinsics", (None, 3, 3)).astype(np.float64)
    _check_count(arrays, "intrinsics", len(matrices), shape[0])
    with np.errstate(invalid="ignore"):  # of NaN, which is refused below by its row
        matrices[:, :2, 2] += shift
    named = texts(arrays, "image_names", 1).tolist() if "image_names" in arrays.names() else []
    names = named if len(named) == len(matrices) else None
    with _camera_errors(arrays, "intrinsics"):
        cameras = Cameras.from_matrices(matrices, shape[2], shape[1], names=names)
    check_resolution(cameras, names, f"{arrays.path}, field 'intrinsics'")
    return cameras


def read_image_poses(arrays: Arrays, count: int) -> ImagePoses:
    """Read ``extrinsics`` and, where there are any, ``image_names`` of `count` images."""
    named = "image_names" in arrays.names()
    names = np.array([f"view {row}" for row in range(count)])

    def refuse(field: str, what: str, odd: list[Any]) -> None:
        if odd:
            raise _fault(arrays, f"{what}: {first_of(odd, count)}", field, _POSES)

    if named:
        names = texts(arrays, "image_names", 1)
        _check_count(arrays, "image_names", len(names), count)
        uses = Counter(names.tolist())
        wrong = [repr(name) for name in uses if uses[name] > 1 or not name]
        refuse("image_names", "names that are empty or not unique", wrong)
    values = arrays.read("extrinsics")
    rows = 4 if values.ndim == 3 and values.shape[1] == 4 else 3
    matrices = numbers(arrays, "extrinsics", (None, rows, 4)).astype(np.float64)
    _check_count(arrays, "extrinsics", len(matrices), count)
    posed = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    half = names[~posed & ~np.isnan(matrices).all(axis=(1, 2))]
    refuse("extrinsics", "poses that are NaN or infinite in part", half.tolist())
    rotation = np.tile(np.eye(3), (count, 1, 1))
    with _camera_errors(arrays, "extrinsics"):
        rotation[posed] = check_rotations(matrices[posed, :3, :3], names[posed].tolist())
    last = np.abs(matrices[posed, 3:] - (0.0, 0.0, 0.0, 1.0)) <= _ROW_TOLERANCE
    odd = names[posed][~last.all(axis=(1, 2))].tolist()
    refuse("extrinsics", "a last row other than 0 0 0 1 (transposed matrices have t there)", odd)
    posed &= (np.abs(matrices[:, :3, 3]) <= FARTHEST).all(axis=1)
    translation = np.where(posed[:, None], matrices[:, :3, 3], 0.0)
    errors = np.zeros(count)
    errors[posed] = pose_errors_m(matrices[posed, :3, :3], translation[posed], None)
    return ImagePoses(names, posed, Poses.from_translations(rotation, translation), errors, named)


def _check_count(arrays: Arrays, name: str, rows: int, count: int) -> None:
    if rows != count:
        raise _fault(arrays, f"has {rows:,} rows for {count:,} images", name, "a row an image")


@contextmanager
def _camera_errors(arrays: Arrays, field: str) -> Iterator[None]:
    """Name the field in errors of cameras and rotations."""
    try:
        yield
    except CameraError as error:
        raise _fault(arrays, error.what, field, error.expected, error.fix) from error
