"""A file or a line of text a frame: CUT3R, VGGT-SLAM, and clouds with trajectories of SLAM systems.

Depth Anything 3's streaming runs are such, too, and are rows of `reconstructions`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of, readable
from airzoo_bench.core.files import npz_fields
from airzoo_bench.formats.arrays import gather
from airzoo_bench.formats.clouds.cloud import FileCloud, open_cloud
from airzoo_bench.formats.npz import Budget, NpzFile, map_numbers
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.readers import scenes
from airzoo_bench.readers.names import names_in, read_names
from airzoo_bench.readers.pose_files import TUM, read_trajectory, trajectory_columns
from airzoo_bench.reconstruction.predictions import ImagePoses, ScenePrediction, read_image_poses

_WHOLE = "all files of a run that went to its end, as the method wrote them"
_CLOUDS = (".ply", ".pcd", ".las", ".laz", ".xyz", ".pts")
_NUMBER = r"\d+(?:\.\d+)?"
_TWICE = 2  # neighbouring submaps share a frame


def missing_files_error(where: Path, what: str) -> PredictionError:
    """Return the error of a run that lacks files."""
    fix = "copy the whole folder, of one run, or run the method again, to its end"
    return PredictionError(what, where=where, expected=_WHOLE, fix=fix)


def frame_files(folder: Path, pattern: str, wanted: Sequence[float] | None = None) -> list[Path]:
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
        raise missing_files_error(folder, what)
    return [by_number[number] for number in numbers]


def read_fields(path: Path, names: Sequence[str], memory: int) -> list[NDArray[Any]]:
    """Read some fields of an npz, which has them all."""
    file = NpzFile(path, memory, npz_fields(path) - {*names})
    if not {*names} <= file.names():
        raise missing_files_error(path, f"lacks {' or '.join(names)}")
    return [file.read(name) for name in names]


def gather_maps(files: Sequence[Path], read: Callable[[Path], NDArray[Any]]) -> NDArray[Any]:
    """Read the map of each file."""
    return gather(files, lambda row: read(files[row]))


def _poses_of(path: Path, camera_to_world: Floats, names: scenes.ViewNames | None) -> ImagePoses:
    """Return cameras of matrices (N, 4, 4), under names if there are any."""
    count, fields = len(camera_to_world), {"extrinsics": scenes.invert_poses(camera_to_world)}
    if names is not None:
        names.check(path, count)
        fields["image_names"] = np.array(names.names, dtype=str)
    return read_image_poses(scenes.MadeArrays(path, Budget(1 << 30), fields), count)


class _Cut3rDemo(scenes.Layout):
    """The folders that CUT3R's demo.py writes: depth, conf and camera, a file a view in each."""

    said = ("pose camera-to-world, axes of OpenCV", *scenes.CENTRES_AND_SIZE)

    def sure(self, place: Path) -> float:
        fields = npz_fields(place / "camera" / "000000.npz")
        return 0.9 * ({"pose", "intrinsics"} <= fields and (place / "depth").is_dir())

    def views(self, output: scenes.SceneOutput) -> scenes.ViewNames | None:
        return output.view_names(output.place / "images")

    def read(self, output: scenes.SceneOutput, memory: int) -> ScenePrediction:
        place = output.place
        depth = frame_files(place / "depth", r"(\d+)\.npy")
        views = range(len(depth))
        files = frame_files(place / "camera", r"(\d+)\.npz", views)
        cameras = [read_fields(path, ("pose", "intrinsics"), memory) for path in files]
        with readable(place / "camera", "holds matrices of several shapes"):
            poses, intrinsics = (np.stack(one) for one in zip(*cameras, strict=True))
        fields: dict[str, Any] = {
            "intrinsics": intrinsics,
            "extrinsics": scenes.invert_poses(poses),
        }
        fields["depth"] = gather_maps(depth, map_numbers)
        if (place / "conf").is_dir():
            fields["conf"] = gather_maps(
                frame_files(place / "conf", r"(\d+)\.npy", views), map_numbers
            )
        return scenes.scene_of(place, Budget(memory), fields, self.views(output))


class _Cut3rTrajectory(scenes.Layout):
    """A text of a number with a camera a row, quaternions w x y z."""

    said = ("camera-to-world, quaternions w x y z, axes of OpenCV; cameras alone",)

    def sure(self, place: Path) -> float:
        return 0.9 * (trajectory_columns(self._file(place)) == TUM)

    def _file(self, place: Path) -> Path:
        path = place / "pred_traj.txt" if place.is_dir() else place
        return path if path.name == "pred_traj.txt" else Path()

    def views(self, output: scenes.SceneOutput) -> scenes.ViewNames | None:
        return output.view_names(self._file(output.place).parent / "images")

    def read(self, output: scenes.SceneOutput, memory: int) -> ScenePrediction:
        path, dtype = self._file(output.place), np.dtype(np.float64)
        _, poses = read_trajectory(path, TUM, memory, w_first=True)
        note = "cameras alone, without a surface, which scores 0: demo.py --output_dir writes depth"
        cloud = FileCloud(path, "cameras", 0, lambda _: iter(()), dtype, (note,))
        return ScenePrediction(cloud, _poses_of(path, poses, self.views(output)), (note,))


class _PosesAndPoints(scenes.Layout):
    """``poses.txt`` of VGGT-SLAM's --log_results, with the point maps in ``poses_logs``.

    A camera's number is the first number in the name of its photo, and the name of its points.
    """

    said = (
        "poses camera-to-world, quaternions x y z w, axes of OpenCV",
        "pixels outside the mask are no surface",
        "of a frame that two submaps share, the later one's pose and points",
    )

    def sure(self, place: Path) -> float:
        text = self._text(place)
        first = None if text is None else next(_logs(text).glob("*.npz"), None)
        return 0.9 * (first is not None and npz_fields(first) >= {"pointcloud", "mask"})

    def _text(self, place: Path) -> Path | None:
        """Return the text of a scene: itself, or the one in its folder with maps."""
        texts = place.glob("*.txt") if place.is_dir() else [place]
        found = [one for one in texts if _logs(one).is_dir() and trajectory_columns(one) == TUM]
        return found[0] if len(found) == 1 else None

    def order(self, output: scenes.SceneOutput) -> str:
        listed = output.request.names
        if listed is None:
            return "numbers are the first number in the name of each photo"
        return f"numbers are lines, from 0, of {listed.name}, or those that stand there"

    def read(self, output: scenes.SceneOutput, memory: int) -> ScenePrediction:
        text = self._text(output.place) or output.place
        numbers, poses = read_trajectory(text, TUM, memory)
        last = {number: row for row, number in enumerate(numbers)}
        names, poses = _names_by_number(output, text, numbers), poses[[*last.values()]]
        files = frame_files(_logs(text), rf"({_NUMBER})\.npz", list(last))
        maps = gather_maps(files, lambda path: _masked_points(path, memory))
        fields = {"world_points": maps, "extrinsics": scenes.invert_poses(poses)}
        return scenes.scene_of(text, Budget(memory), fields, names)


def _logs(text: Path) -> Path:
    return text.with_name(text.name.replace(".txt", "_logs"))


def _names_by_number(
    output: scenes.SceneOutput, text: Path, numbers: Sequence[float]
) -> scenes.ViewNames:
    """Return the photo of each number, by the names of photos or by ``--names``."""
    times, unclear = Counter(numbers), False
    if output.request.names is not None:
        photos = _number_listed(output, output.request.names)
    else:
        truths = [one for one in output.request.truths if one.scene == output.scene]
        names = [image for _, image in names_in(truth.photos for truth in truths)]
        found = [(re.search(_NUMBER, name.rsplit("/", 1)[-1]), name) for name in names]
        photos = {float(number[0]): name for number, name in found if number is not None}
        unclear = len(photos) < len(names)
    odd = [n for n, count in times.items() if n not in photos or count > _TWICE]
    if odd or unclear:
        listed = first_of([f"{number:.10g}" for number in odd or times], len(times))
        what = f"its numbers are of no photo, or of several (a date in names is one): {listed}"
        expected = "the first number in the name of each photo; or lines of --names: 'number name'"
        fix = "rename the photos to numbers first, as docs/recipes/reconstruction.md does"
        raise PredictionError(what, where=text, expected=expected, fix=fix)
    return scenes.ViewNames([photos[number] for number in times])


def _number_listed(output: scenes.SceneOutput, path: Path) -> dict[float, str]:
    """Return the photos that a list has by number: ``number name``, or lines from 0."""
    listed = read_names(path)
    lines = [re.fullmatch(rf"({_NUMBER})\s+(.+)", line) for line in listed]
    numbers = {line[2]: float(line[1]) for line in lines if line is not None}
    if len(numbers) < len(lines):
        return dict(enumerate(output.photos(output.names_of_scene(listed))))
    names = output.names_of_scene(list(numbers))
    return dict(zip((numbers[name] for name in names), output.photos(names), strict=True))


def _masked_points(path: Path, memory: int) -> NDArray[Any]:
    """Return the points (H, W, 3) of a frame, NaN where its mask is False."""
    points, mask = read_fields(path, ("pointcloud", "mask"), memory)
    kinds = points.dtype.kind + mask.dtype.kind
    if points.ndim != 3 or mask.shape != points.shape[:2] or kinds != "fb":
        has = [f"{one.dtype} of shape {one.shape}" for one in (points, mask)]
        what = f"pointcloud is {has[0]}, mask {has[1]}"
        raise PredictionError(what, where=path, expected="(H, W, 3), and (H, W) of bool")
    found: NDArray[Any] = np.where(mask.view(np.uint8)[..., None] != 0, points, np.nan)
    return found


class _CloudWithTrajectory(scenes.Layout):
    """A folder with one cloud and one text of poses, as SLAM systems leave them."""

    said = (
        "poses camera-to-world, axes of OpenCV, in the frame of the cloud",
        "8 numbers a row: time stamp, tx ty tz, qx qy qz qw; 12: the 3 x 4 matrix [R | C]",
    )

    def sure(self, place: Path) -> float:
        """See `Layout.sure`; of a method that writes such files, its own reader is surer."""
        return 0.55 * (len(self._files(place)) == 2)

    def _files(self, place: Path) -> list[Path]:
        """Return the one cloud and the one text of poses in a folder; nothing for others."""
        files = sorted(one for one in place.iterdir() if one.is_file()) if place.is_dir() else []
        clouds = [one for one in files if one.name.lower().endswith(_CLOUDS)]
        texts = [one for one in files if trajectory_columns(one) is not None]
        return [*clouds, *texts] if len(texts) == len(clouds) == 1 else []

    def read(self, output: scenes.SceneOutput, memory: int) -> ScenePrediction:
        cloud, text = self._files(output.place)
        _, poses = read_trajectory(text, trajectory_columns(text) or TUM, memory)
        cameras = _poses_of(text, poses, output.view_names())
        return ScenePrediction(open_cloud(cloud, limit_bytes=memory, sampling=None), cameras)


CUT3R = scenes.SceneReader(
    "depth maps and cameras of CUT3R",
    "folders depth and camera of 000000.npy, 000000.npz (pose, intrinsics); or pred_traj.txt",
    ("CUT3R",),
    *(_Cut3rDemo(), _Cut3rTrajectory()),
)
VGGT_SLAM = scenes.SceneReader(
    "poses and point maps of VGGT-SLAM",
    "poses.txt (number, place, quaternion) and poses_logs/<number>.npz (pointcloud, mask)",
    ("VGGT-SLAM",),
    _PosesAndPoints(),
)
CLOUD_TRAJECTORY = scenes.SceneReader(
    "a cloud with a trajectory of TUM or KITTI",
    "a folder a scene with one cloud and one text of 8 (TUM) or 12 (KITTI) numbers a row",
    ("SLAM systems", "evo"),
    _CloudWithTrajectory(),
)
