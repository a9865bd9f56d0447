"""VGGT-SLAM: ``poses.txt`` of --log_results, and the point maps in ``poses_logs`` beside it.

A camera's number is the first number in the name of its photo, and the name of its file of points.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.files import npz_fields
from airzoo_bench.readers.map_files import maps_of_files
from airzoo_bench.readers.scene_folders import ScenePlaces, SceneReader
from airzoo_bench.readers.trajectories import (
    Trajectory,
    cameras_only,
    looks_like_trajectory,
    read_trajectory,
)
from airzoo_bench.readers.view_files import GivenArrays, inverted

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = ["VGGT_SLAM", "VggtSlam"]

_FIELDS = ("pointcloud", "mask")
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_WRITTEN = re.compile(rb"-?\d+\.\d{8}( -?\d+\.\d{8}){7}\n")
_TWICE = 2  # neighbouring submaps share a frame
_RENAME = """rename the photos to bare numbers first, and give their names with --names:
  photos = sorted(Path("photos").iterdir())
  Path("names.txt").write_text("\\n".join(photo.name for photo in photos))
  Path("numbered").mkdir()
  for number, photo in enumerate(photos):
      shutil.copy(photo, f"numbered/{number:06d}{photo.suffix}")"""


class VggtSlam(SceneReader):
    """Reads point maps with their cameras, or cameras alone."""

    title = "poses and point maps of VGGT-SLAM"
    layout = "poses.txt (number, place, quaternion) and poses_logs/<number>.npz (pointcloud, mask)"
    methods = ("VGGT-SLAM",)

    def sure_of(self, place: Path) -> float:
        """Look at the lines of the text, and for the folder beside it."""
        text = _text(place)
        if text is None:
            return 0.0
        if _has_maps(_logs(text)):
            return 0.9
        with text.open("rb") as stream:  # without maps, digits as it writes them are all there is
            own = _WRITTEN.fullmatch(stream.readline(512)) is not None
        return 0.6 if own and text.name == "poses.txt" else 0.0

    def conventions(self, scenes: ScenePlaces) -> tuple[str, ...]:
        """See `SceneReader.conventions`."""
        listed = scenes.reading.names
        if listed is not None:
            named = f"number k is line k, from 0, of {listed.name}, or the photo with it there"
        else:
            named = "numbers are the first number in the name of each photo"
        return (
            "poses camera-to-world, quaternions x y z w, axes of OpenCV",
            "pixels outside the mask are no surface",
            "of a frame that two submaps share, the later one's pose and points",
            named,
        )

    def read_scene(self, scenes: ScenePlaces, place: Path, memory: int) -> ScenePrediction:
        """See `SceneReader.read_scene`."""
        text = _text(place)
        if text is None:
            raise PredictionError(
                "is no text of poses of VGGT-SLAM, and holds not one alone",
                where=place,
                expected="poses.txt, a line a camera",
                fix="copy what --log_results wrote, of one run",
            )
        trajectory = _last_of_each(read_trajectory(text, w_first=False))
        names = _names(scenes, place, trajectory)
        folder = _logs(text)
        if not folder.is_dir():
            return cameras_only(trajectory, names, "leave out --skip_dense_log")
        files = _files(folder, trajectory)
        return _read(trajectory, names, files, memory)


def _text(place: Path) -> Path | None:
    """Return the text of a scene: itself, or the one in its folder with maps beside it."""
    if not place.is_dir():
        fits = place.suffix == ".txt" and place.is_file() and looks_like_trajectory(place)
        return place if fits else None
    texts = [
        one
        for one in sorted(place.glob("*.txt"))
        if (one.name == "poses.txt" or _logs(one).is_dir()) and looks_like_trajectory(one)
    ]
    return texts[0] if len(texts) == 1 else None


def _logs(text: Path) -> Path:
    return text.with_name(text.name.replace(".txt", "_logs"))


def _has_maps(folder: Path) -> bool:
    first = next(folder.glob("*.npz"), None) if folder.is_dir() else None
    return first is not None and npz_fields(first) >= {*_FIELDS}


def _last_of_each(trajectory: Trajectory) -> Trajectory:
    """Keep the last line of each number; refuse numbers that too many lines share."""
    import numpy as np

    times = Counter(trajectory.numbers)
    shared = [f"{number:.10g}" for number, count in times.items() if count > _TWICE]
    if shared or (len(times) == 1 and len(trajectory.numbers) > 1):
        raise PredictionError(
            f"{counted(len(trajectory.numbers), 'line')} share "
            f"{counted(len(times), 'number')}: {first_of(shared or times)}",
            where=trajectory.path,
            expected="a number a photo; VGGT-SLAM takes the first number in a name, which is the "
            "date in DJI_20260101101500_0001.JPG",
            fix=_RENAME,
        )
    last = {number: row for row, number in enumerate(trajectory.numbers)}
    rows = list(last.values())
    return Trajectory(trajectory.path, list(last), trajectory.camera_to_world[np.array(rows)])


def _names(scenes: ScenePlaces, place: Path, trajectory: Trajectory) -> list[str]:
    """Return the photo of each number."""
    if scenes.reading.names is not None:
        listed = scenes.numbered_names(place)
        photos = dict(zip(listed, scenes.photos(place, list(listed.values())), strict=True))
    else:
        photos = _by_number(scenes.photo_names(place), trajectory.path)
        if not photos:  # without the benchmark folder; scoring says that it is missing
            return [f"{number:.10g}" for number in trajectory.numbers]
    lost = [f"{number:.10g}" for number in trajectory.numbers if number not in photos]
    if lost:
        raise PredictionError(
            f"numbers that are of no photo: {first_of(lost, len(trajectory.numbers))}",
            where=trajectory.path,
            expected="the first number in the name of each photo, or lines of --names: "
            "'number name', or names alone, counted from 0",
            fix=_RENAME,
        )
    return [photos[number] for number in trajectory.numbers]


def _by_number(names: list[str], where: Path) -> dict[float, str]:
    found: dict[float, str] = {}
    for name in names:
        number = _NUMBER.search(name.rsplit("/", 1)[-1])
        if number is None or float(number.group()) in found:
            what = "has no number" if number is None else "has the first number of another photo"
            raise PredictionError(
                f"the photo {name!r} {what}: its camera cannot be told",
                where=where,
                expected="another first number in the name of each photo",
                fix=_RENAME,
            )
        found[float(number.group())] = name
    return found


def _files(folder: Path, trajectory: Trajectory) -> list[Path]:
    files: dict[float, Path] = {}
    for path in sorted(folder.glob("*.npz")):
        if _NUMBER.fullmatch(path.stem):
            files[float(path.stem)] = path
    lost = [f"{number}.npz" for number in trajectory.numbers if number not in files]
    other = [files[number].name for number in files.keys() - {*trajectory.numbers}]
    if lost or other:
        what = "files are missing" if lost else f"files of no line of {trajectory.path.name}"
        raise PredictionError(
            f"{what}: {first_of(lost or sorted(other), len(trajectory.numbers))}",
            where=folder,
            expected="the points of each camera, all of one run",
            fix="copy the whole folder, or run again into an empty one",
        )
    return [files[number] for number in trajectory.numbers]


def _read(
    trajectory: Trajectory, names: list[str], files: list[Path], memory: int
) -> ScenePrediction:
    import numpy as np

    from airzoo_bench.formats.budget import Budget
    from airzoo_bench.reconstruction.predictions import maps_of

    def size_of(path: Path) -> tuple[tuple[int, ...], Any]:
        from airzoo_bench.formats.npz import NpzFile

        entries = NpzFile(path, memory).entries
        if not {*_FIELDS} <= entries.keys():
            raise PredictionError(
                "lacks pointcloud or mask", where=path, expected="both, as VGGT-SLAM writes them"
            )
        points, mask = entries["pointcloud"], entries["mask"]
        if len(points.shape) != 3 or mask.shape != points.shape[:2] or mask.dtype.kind != "b":
            raise PredictionError(
                f"pointcloud has shape {points.shape}, mask {mask.shape} of {mask.dtype}",
                where=path,
                expected="pointcloud (H, W, 3) and a mask (H, W) of bool",
            )
        return points.shape, points.dtype

    maps = maps_of_files(files, size_of, lambda path: _points(path, memory))
    given: dict[str, Any] = {
        "world_points": lambda: maps,
        "extrinsics": lambda: inverted(trajectory.camera_to_world),
        "image_names": lambda: np.array(names, dtype=str),
    }
    return maps_of(GivenArrays(trajectory.path, Budget(memory), given))


def _points(path: Path, memory: int) -> NDArray[Any]:
    """Return the points (H, W, 3) of a frame, NaN where its mask is False."""
    import numpy as np

    from airzoo_bench.formats.npz import NpzFile

    file = NpzFile(path, memory)
    kept = file.read("mask").view(np.uint8) != 0
    points: NDArray[Any] = np.where(kept[..., None], file.read("pointcloud"), np.nan)
    return points


VGGT_SLAM = VggtSlam()
