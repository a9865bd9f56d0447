"""Methods of reconstruction: what their files are called, and what their arrays mean."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, counted, first_of, readable
from airzoo_bench.core.files import first_bytes, npz_fields
from airzoo_bench.formats.arrays import numbers
from airzoo_bench.formats.npz import Budget, NpzFile, map_numbers
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import unit_quaternion_to_matrix
from airzoo_bench.readers.models import (
    Model,
    is_of_depth_anything_3,
    is_of_mapanything,
    is_of_vggt,
)
from airzoo_bench.readers.scenes import Layout, Refused, SceneOutput, SceneReader, ViewNames
from airzoo_bench.readers.trajectories import (
    TUM,
    CamerasAlone,
    CloudWithTrajectory,
    Trajectory,
    cameras_only,
    read_trajectory,
    trajectory_columns,
)
from airzoo_bench.readers.views import CENTRES_AND_SIZE, ViewArrays, inverted, scene_of
from airzoo_bench.reconstruction.fusion import LazyMaps
from airzoo_bench.reconstruction.predictions import ScenePrediction

# --- a file a frame, read one at a time ---

_AGAIN = "copy the whole folder, of one run, or run the method again, to its end"


def _frame_files(folder: Path, pattern: str, wanted: Sequence[float] | None = None) -> list[Path]:
    """Return the files of numbers, from 0 on unless they are given; refuse others and gaps.

    The pattern's only group is the number in a name.
    """
    names = sorted(one.name for one in folder.iterdir()) if folder.is_dir() else []
    matches = filter(None, (re.fullmatch(pattern, name) for name in names))
    found = [(float(match[1]), folder / match[0]) for match in matches]
    by_number = dict(found)
    numbers = range(len(found)) if wanted is None else wanted
    lost = [f"{number:g}" for number in numbers if number not in by_number]
    if lost or not found or len(found) > len({*numbers}):
        what = f"files are missing, or of no frame: {first_of(lost, len(numbers))}"
        raise _not_whole(folder, what)
    return [by_number[number] for number in numbers]


def _not_whole(where: Path, what: str) -> PredictionError:
    expected = "all files of a run that went to its end, as the method wrote them"
    return PredictionError(what, where=where, expected=expected, fix=_AGAIN)


def _lazy_maps(files: Sequence[Path], read: Callable[[Path], NDArray[Any]]) -> LazyMaps:
    """Return the maps of files, each read when it is asked for, all of the first one's size."""
    first = read(files[0])
    if first.ndim not in (2, 3):
        raise PredictionError(f"has shape {first.shape}", where=files[0], expected="a map a file")

    def frame(row: int) -> NDArray[Any]:
        found = read(files[row])
        if found.shape != first.shape or found.dtype != first.dtype:
            what = f"is {found.dtype} of shape {found.shape}"
            expected = f"{first.dtype} of shape {first.shape}, as in {files[0].name}"
            raise PredictionError(what, where=files[row], expected=expected)
        return found

    return LazyMaps(np.arange(len(files)), first.shape, first.dtype, frame)


def _read_fields(path: Path, names: Sequence[str], memory: int) -> list[NDArray[Any]]:
    """Read some fields of an npz, which has them all."""
    file = NpzFile(path, memory, npz_fields(path) - {*names})
    if not {*names} <= file.names():
        raise _not_whole(path, f"lacks {' or '.join(names)}")
    return [file.read(name) for name in names]


class _Cut3rDemo(Layout):
    """The folders that CUT3R's demo.py writes: depth, conf and camera, a file a view in each."""

    said = ("pose camera-to-world, axes of OpenCV", *CENTRES_AND_SIZE)

    def sure(self, place: Path) -> float:
        fields = npz_fields(place / "camera" / "000000.npz")
        return 0.9 * ({"pose", "intrinsics"} <= fields and (place / "depth").is_dir())

    def views(self, output: SceneOutput) -> ViewNames | None:
        return output.view_names(output.place / "images")

    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        place = output.place
        depth = _frame_files(place / "depth", r"(\d+)\.npy")
        views = range(len(depth))
        files = _frame_files(place / "camera", r"(\d+)\.npz", views)
        cameras = [_read_fields(path, ("pose", "intrinsics"), memory) for path in files]
        with readable(place / "camera", "holds matrices of several shapes"):
            poses, intrinsics = (np.stack(one) for one in zip(*cameras, strict=True))
        fields: dict[str, Any] = {"intrinsics": intrinsics, "extrinsics": inverted(poses)}
        fields["depth"] = _lazy_maps(depth, _read_npy)
        if (place / "conf").is_dir():
            confidence = _frame_files(place / "conf", r"(\d+)\.npy", views)
            fields["conf"] = _lazy_maps(confidence, _read_npy)
        return scene_of(place, Budget(memory), fields, self.views(output))


def _read_npy(path: Path) -> NDArray[Any]:
    return np.array(map_numbers(path))


class _Streaming(Layout):
    """A streaming run of Depth Anything 3: poses and intrinsics as text, and an npz a frame.

    The poses are written last, so that frames without them are those of a run that did not end.
    """

    poses, lenses, frames = "camera_poses.txt", "intrinsic.txt", "results_output"
    said = ("camera_poses.txt camera-to-world, axes of OpenCV", *CENTRES_AND_SIZE)

    def sure(self, place: Path) -> float:
        # Runs that did not end are recognised too.
        there = [(place / name).is_file() for name in (self.poses, self.lenses)]
        half = (any(there) or (place / "pcd").is_dir()) and (place / self.frames).is_dir()
        return 0.9 * (all(there) or (half and any((place / self.frames).glob("frame_*.npz"))))

    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        place, budget = output.place, Budget(memory)
        poses = self._table(place / self.poses, 16).reshape(-1, 4, 4)
        focal = self._table(place / self.lenses, 4)
        if len(focal) != len(poses):
            lines = f"{len(poses):,} lines of poses, {len(focal):,} of intrinsics"
            raise _not_whole(place, f"is a run that did not end: {lines}")
        files = _frame_files(place / self.frames, r"frame_(\d{1,9})\.npz", range(len(poses)))
        matrices = np.tile(np.eye(3), (len(focal), 1, 1))
        matrices[:, (0, 1, 0, 1), (0, 1, 2, 2)] = focal
        fields: dict[str, Any] = {"intrinsics": matrices, "extrinsics": inverted(poses)}
        fields["depth"] = _lazy_maps(files, lambda path: _read_fields(path, ("depth",), memory)[0])
        fields["conf"] = _lazy_maps(files, lambda path: _read_fields(path, ("conf",), memory)[0])
        return scene_of(place, budget, fields, output.view_names())

    def _table(self, path: Path, columns: int) -> Floats:
        """Read lines of numbers, all with as many."""
        expected = "all files of a run that went to its end, as the method wrote them"
        with readable(path, f"no text of {columns} numbers a line", expected=expected, fix=_AGAIN):
            return np.loadtxt(path, ndmin=2).reshape(-1, columns)


_NUMBER = r"\d+(?:\.\d+)?"
_RENAME = """rename the photos to bare numbers first, and give their names with --names:
  photos = sorted(Path("photos").iterdir())
  Path("names.txt").write_text("\\n".join(photo.name for photo in photos))
  Path("numbered").mkdir()
  for number, photo in enumerate(photos):
      shutil.copy(photo, f"numbered/{number:06d}{photo.suffix}")"""
_TWICE = 2  # neighbouring submaps share a frame


class _PosesAndPoints(Layout):
    """``poses.txt`` of VGGT-SLAM's --log_results, and the point maps in ``poses_logs`` beside it.

    A camera's number is the first number in the name of its photo, and the name of its points.
    """

    said = (
        "poses camera-to-world, quaternions x y z w, axes of OpenCV",
        "pixels outside the mask are no surface",
        "of a frame that two submaps share, the later one's pose and points",
    )

    def sure(self, place: Path) -> float:
        # Without maps, digits as it writes them are all there is.
        text = self._text(place)
        if text is None:
            return 0.0
        first = next(_logs(text).glob("*.npz"), None)
        if first is not None and npz_fields(first) >= {"pointcloud", "mask"}:
            return 0.9
        with text.open("rb") as stream:
            line = stream.readline(512)
        own = re.fullmatch(rb"-?\d+\.\d{8}( -?\d+\.\d{8}){7}\n", line) is not None
        return 0.6 * (own and text.name == "poses.txt")

    def _text(self, place: Path) -> Path | None:
        """Return the text of a scene: itself, or the one in its folder with maps beside it."""
        if not place.is_dir():
            return place if place.suffix == ".txt" and trajectory_columns(place) == TUM else None
        texts = [
            one
            for one in sorted(place.glob("*.txt"))
            if (one.name == "poses.txt" or _logs(one).is_dir()) and trajectory_columns(one) == TUM
        ]
        return texts[0] if len(texts) == 1 else None

    def order(self, output: SceneOutput) -> str:
        listed = output.reading.names
        if listed is None:
            return "numbers are the first number in the name of each photo"
        return f"numbers are lines, from 0, of {listed.name}, or those that stand there"

    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        text = self._text(output.place) or output.place
        trajectory = read_trajectory(text, TUM, memory)
        last = {number: row for row, number in enumerate(trajectory.numbers)}
        names = _names_by_number(output, trajectory)
        poses = trajectory.camera_to_world[[*last.values()]]
        trajectory = Trajectory(trajectory.path, list(last), poses)
        if not _logs(text).is_dir():
            return cameras_only(trajectory, names, "leave out --skip_dense_log")
        files = _frame_files(_logs(text), rf"({_NUMBER})\.npz", trajectory.numbers)
        maps = _lazy_maps(files, lambda path: _masked_points(path, memory))
        fields = {"world_points": maps, "extrinsics": inverted(poses)}
        return scene_of(text, Budget(memory), fields, names)


def _logs(text: Path) -> Path:
    return text.with_name(text.name.replace(".txt", "_logs"))


def _names_by_number(output: SceneOutput, trajectory: Trajectory) -> ViewNames:
    """Return the photo of each number."""
    times, unclear = Counter(trajectory.numbers), False
    if output.reading.names is not None:
        photos = output.numbered_photos()
    else:
        names = output.photos_of_scene()
        found = [(re.search(_NUMBER, name.rsplit("/", 1)[-1]), name) for name in names]
        photos = {float(number[0]): name for number, name in found if number is not None}
        unclear = len(photos) < len(names)
    odd = [n for n, count in times.items() if n not in photos or count > _TWICE]
    if odd or unclear:
        lines = counted(len(trajectory.numbers), "line")
        listed = first_of([f"{number:.10g}" for number in odd or times], len(times))
        raise PredictionError(
            f"{lines} have {counted(len(times), 'number')}, and these are of no photo or of "
            f"several: {listed}",
            where=trajectory.path,
            expected="the first number in the name of each photo, which is the date in "
            "DJI_20260101101500_0001.JPG; or lines of --names: 'number name', or names from 0",
            fix=_RENAME,
        )
    return ViewNames([photos[number] for number in times])


def _masked_points(path: Path, memory: int) -> NDArray[Any]:
    """Return the points (H, W, 3) of a frame, NaN where its mask is False."""
    points, mask = _read_fields(path, ("pointcloud", "mask"), memory)
    kinds = points.dtype.kind + mask.dtype.kind
    if points.ndim != 3 or mask.shape != points.shape[:2] or kinds != "fb":
        has = [f"{one.dtype} of shape {one.shape}" for one in (points, mask)]
        what = f"pointcloud is {has[0]}, mask {has[1]}"
        raise PredictionError(what, where=path, expected="(H, W, 3), and (H, W) of bool")
    found: NDArray[Any] = np.where(mask.view(np.uint8)[..., None] != 0, points, np.nan)
    return found


# --- methods ---

_DEPTH_OR_POINTS = {"depth": "depth", "world_points": "world_points"}


def _decoded(file: NpzFile, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Decode pose_enc: translation, quaternion x y z w (world-to-camera), fields of view y, x."""
    has_batch = len(file.entries["pose_enc"].shape) != 2
    code = numbers(file, "pose_enc", (1, None, 9) if has_batch else (None, 9))
    code = code.astype(np.float64).reshape(-1, 9)
    height, width = shape[1:3]
    with np.errstate(all="ignore"):  # NaN and zeros are refused by their matrices
        quaternion = code[:, (6, 3, 4, 5)] / np.linalg.norm(code[:, 3:7], axis=1, keepdims=True)
        focal = np.array((width, height)) / 2.0 / np.tan(code[:, (8, 7)] / 2.0)
    rotation = unit_quaternion_to_matrix(quaternion)
    intrinsics = np.tile(np.eye(3), (len(code), 1, 1))
    intrinsics[:, (0, 1), (0, 1)] = focal
    intrinsics[:, :2, 2] = np.array((width, height)) / 2.0
    return intrinsics, np.concatenate([rotation, code[:, :3, None]], axis=2)


VGGT = SceneReader(
    "depth maps of VGGT",
    "predictions.npz with depth or world_points, and pose_enc or their own confidence",
    ("VGGT",),
    ViewArrays(
        maps=_DEPTH_OR_POINTS,
        confidence={"depth": "depth_conf", "world_points": "world_points_conf"},
        needed=(
            {"depth", "world_points"},
            {"pose_enc", "depth_conf", "world_points_conf"},
            {"pose_enc", "extrinsic"},
            {"pose_enc", "intrinsic"},
        ),
        never=frozenset({"final_mask"}),
        extrinsics="extrinsic",
        intrinsics="intrinsic",
        cameras=_decoded,
        said=(
            "depth is read, and world_points only where there is none",
            "extrinsic world-to-camera, axes of OpenCV",
            *CENTRES_AND_SIZE,
        ),
    ),
)
VGGT_COLMAP = SceneReader(
    "COLMAP models of VGGT",
    "sparse/ with points.ply, whose cameras all have their principal point in the middle",
    ("VGGT",),
    Model(is_of_vggt, any_other=True),
)
MAPANYTHING = SceneReader(
    "depth maps or COLMAP models of MapAnything",
    "predictions.npz with depth, extrinsic and final_mask; or sparse/ with points.ply and cameras "
    "of the size that the network sees",
    ("MapAnything",),
    Model(is_of_mapanything),
    ViewArrays(
        maps=_DEPTH_OR_POINTS,
        confidence={"depth": "conf", "world_points": "conf"},
        needed=({"depth", "world_points"}, {"extrinsic"}, {"intrinsic"}, {"final_mask"}),
        extrinsics="extrinsic",
        intrinsics="intrinsic",
        mask="final_mask",
        camera_to_world=True,
        said=(
            "depth is read where final_mask is set, and world_points only where there is none",
            "extrinsic camera-to-world, axes of OpenCV",
            *CENTRES_AND_SIZE,
        ),
    ),
)


class _DepthAnything3(SceneReader):
    def sure_within(self, place: Path) -> float:
        # The suite's own layout reads results.npz alone in a scene's folder.
        found = _RESULTS.find(place)
        return 0.2 if found in (place, place / "results.npz") else self.sure(place)


_RESULTS = ViewArrays(
    maps={"depth": "depth"},
    confidence={"depth": "conf"},
    needed=({"depth"}, {"extrinsics"}, {"intrinsics"}),
    only=frozenset({"depth", "extrinsics", "intrinsics", "conf", "image"}),
    extrinsics="extrinsics",
    intrinsics="intrinsics",
    # mini_npz keeps two more decimals than npz.
    files=(
        *("exports/mini_npz/results.npz", "exports/npz/results.npz"),
        *("unposed/exports/mini_npz/results.npz", "unposed/exports/npz/results.npz"),
        *("mini_npz/results.npz", "npz/results.npz", "results.npz"),
    ),
    photos=None,
    said=("extrinsics world-to-camera, axes of OpenCV", *CENTRES_AND_SIZE),
)
DEPTH_ANYTHING_3 = _DepthAnything3(
    "depth maps of Depth Anything 3",
    "results.npz with depth, extrinsics, intrinsics and no names, in exports/; camera_poses.txt "
    "with results_output/; or a COLMAP model with a camera an image",
    ("Depth Anything 3",),
    _RESULTS,
    _Streaming(),
    Model(is_of_depth_anything_3, below="."),
    Refused(
        lambda place: (place / "scene.glb").is_file() and _is_exported(place),
        "scene.glb is turned, moved to its middle point, thinned to a million points, and has the "
        "cameras draw_points into it",
        "exports/mini_npz/results.npz",
        "write depth and cameras too: model.inference(..., export_format='mini_npz')",
    ),
)


def _is_exported(place: Path) -> bool:
    return (place / "scene.jpg").is_file() or (place / "depth_vis").is_dir()


def _is_demo(path: Path) -> bool:
    """Say whether a file is the GLB of a demo: of trimesh, with a mesh for each camera."""
    path = path / "scene.glb" if path.is_dir() else path
    head = first_bytes(path, 1 << 20) if path.name == "scene.glb" else b""
    return head.startswith(b"glTF") and b"trimesh" in head and head.count(b'"primitives"') > 2


DUST3R = SceneReader(
    "point maps of DUSt3R or MASt3R",
    "npz with pts3d and poses, as the recipe's lines save them; scene.glb of the demo",
    ("DUSt3R", "MASt3R"),
    ViewArrays(
        maps={"pts3d": "world_points"},
        confidence={"pts3d": "conf"},
        needed=({"pts3d"}, {"poses"}),
        only=frozenset({"pts3d", "poses", "focals", "conf", "names"}),
        strict=True,
        extrinsics="poses",
        intrinsics="K",
        files=("*.npz",),
        names="names",
        camera_to_world=True,
        photos=None,
        said=(
            "pts3d are points of the world, a pixel of the network's image each",
            "poses camera-to-world, axes of OpenCV",
        ),
    ),
    Refused(
        _is_demo,
        "is what a demo shows: turned to the first view, with cameras as meshes among the points",
        "points in the frame of the cameras that go with them",
        """save the scene itself, after the alignment (docs/recipes/reconstruction.md):
  np.savez("SCENE.npz", pts3d=np.stack([p.detach().cpu() for p in scene.get_pts3d()]),
           poses=scene.get_im_poses().detach().cpu(), focals=scene.get_focals().detach().cpu(),
           conf=np.stack([c.detach().cpu() for c in scene.im_conf]), names=photos)""",
    ),
)
CUT3R = SceneReader(
    "depth maps and cameras of CUT3R",
    "folders depth and camera of 000000.npy, 000000.npz (pose, intrinsics); or pred_traj.txt",
    ("CUT3R",),
    _Cut3rDemo(),
    CamerasAlone("pred_traj.txt", "demo.py --output_dir writes depth maps, too"),
)
VGGT_SLAM = SceneReader(
    "poses and point maps of VGGT-SLAM",
    "poses.txt (number, place, quaternion) and poses_logs/<number>.npz (pointcloud, mask)",
    ("VGGT-SLAM",),
    _PosesAndPoints(),
)
CLOUD_TRAJECTORY = SceneReader(
    "a cloud with a trajectory of TUM or KITTI",
    "a folder a scene with one cloud and one text of 8 (TUM) or 12 (KITTI) numbers a row",
    ("SLAM systems", "evo"),
    CloudWithTrajectory(),
)
