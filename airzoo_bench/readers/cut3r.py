"""CUT3R: the folder that demo.py writes, and ``pred_traj.txt`` of its evaluation of poses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import npz_fields
from airzoo_bench.readers.map_files import (
    check_same_number,
    maps_of_files,
    npy_size,
    numbered,
    read_npy,
)
from airzoo_bench.readers.scene_folders import ScenePlaces, SceneReader
from airzoo_bench.readers.trajectories import cameras_only, looks_like_trajectory, read_trajectory
from airzoo_bench.readers.view_files import (
    GivenArrays,
    ViewNames,
    check_count,
    in_photo_order,
    inverted,
    view_names,
)

if TYPE_CHECKING:
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = ["CUT3R", "Cut3r"]

_FIRST = "000000"
_TRAJECTORY = "pred_traj.txt"
_PICKLED = (b"images_all", b"descr': '|O'")
_DEMO = "the folder that demo.py writes (--output_dir)"
_LINES = """write them as arrays, from Python:
  d = np.load("SCENE.npy", allow_pickle=True).item()
  np.savez("SCENE.npz", world_points=d["pts_all"].astype(np.float32))"""


class Cut3r(SceneReader):
    """Reads depth maps with their cameras, or cameras alone."""

    title = "depth maps and cameras of CUT3R"
    layout = (
        "folders depth and camera of 000000.npy, 000000.npz (pose, intrinsics); or pred_traj.txt"
    )
    methods = ("CUT3R",)

    def sure_of(self, place: Path) -> float:
        """Look at the first files of the folders, and at the lines of a trajectory."""
        if place.is_dir() and (_is_demo(place) or _is_trajectory(place / _TRAJECTORY)):
            return 0.9
        return 0.9 if _is_trajectory(place) or _is_pickled(place) or _is_video(place) else 0.0

    def conventions(self, scenes: ScenePlaces) -> tuple[str, ...]:
        """See `SceneReader.conventions`."""
        places = [one for one in scenes.places.values() if not (_is_pickled(one) or _is_video(one))]
        if not places:
            return ()
        order = in_photo_order(scenes, _photos(places[0]))
        if any(_is_demo(place) for place in places):
            return (
                "pose camera-to-world, axes of OpenCV",
                "pixel centres are integers: the principal point is shifted by half a pixel",
                "intrinsics of the images as the network sees them",
                order,
            )
        return (
            "pred_traj.txt: camera-to-world, quaternions w x y z, axes of OpenCV; cameras alone",
            order,
        )

    def read_scene(self, scenes: ScenePlaces, place: Path, memory: int) -> ScenePrediction:
        """See `SceneReader.read_scene`."""
        if _is_pickled(place):
            raise PredictionError(
                "is a pickle of CUT3R's evaluation of point maps, which is never opened here",
                where=place,
                expected=_DEMO,
                fix=_LINES,
            )
        if _is_video(place):
            raise PredictionError(
                "holds depth of CUT3R's evaluation of videos, which keeps no cameras",
                where=place,
                expected=_DEMO,
                fix="run demo.py on the same photos",
            )
        names = view_names(scenes, place, _photos(place))
        if _is_demo(place):
            return _read_demo(place, memory, names)
        path = place / _TRAJECTORY if place.is_dir() else place
        trajectory = read_trajectory(path, w_first=True)
        what = "demo.py --output_dir writes depth maps, too"
        return cameras_only(trajectory, None if names is None else list(names.names), what)


def _photos(place: Path) -> Path:
    """Return where the photos lie if they were copied beside what the method wrote of them."""
    return (place if place.is_dir() else place.parent) / "images"


def _is_demo(place: Path) -> bool:
    fields = npz_fields(place / "camera" / f"{_FIRST}.npz")
    return {"pose", "intrinsics"} <= fields and (place / "depth").is_dir()


def _is_trajectory(path: Path) -> bool:
    return path.name == _TRAJECTORY and path.is_file() and looks_like_trajectory(path)


def _is_video(place: Path) -> bool:
    """Whether eval/video_depth wrote it; what is beside cameras is left to these."""
    frames = (place / f"frame_0000{ending}" for ending in (".npy", ".png"))
    cameras = (place / "camera", place / _TRAJECTORY)
    return all(one.is_file() for one in frames) and not any(one.exists() for one in cameras)


def _is_pickled(path: Path) -> bool:
    if path.suffix != ".npy" or not path.is_file():
        return False
    try:
        with path.open("rb") as stream:
            head = stream.read(4096)
    except OSError:
        return False
    return all(word in head for word in _PICKLED)


def _read_demo(place: Path, memory: int, names: ViewNames | None) -> ScenePrediction:
    import numpy as np

    from airzoo_bench.formats.budget import Budget
    from airzoo_bench.reconstruction.predictions import maps_of

    depth, cameras = numbered(place / "depth", ".npy"), numbered(place / "camera", ".npz")
    check_same_number(depth, cameras)
    check_count(place, names, len(depth))
    budget = Budget(memory)
    matrices = _cameras(cameras, memory)
    given: dict[str, Any] = {
        "depth": lambda: _maps(depth),
        "intrinsics": lambda: matrices["intrinsics"],
        "extrinsics": lambda: inverted(matrices["pose"]),
        "pixel_centres": lambda: np.array("integer"),
    }
    if (place / "conf").is_dir():
        confidence = numbered(place / "conf", ".npy")
        check_same_number(depth, confidence)
        given["conf"] = lambda: _maps(confidence)
    if names is not None:
        given["image_names"] = lambda: np.array(names.names, dtype=str)
    return maps_of(GivenArrays(place, budget, given))


def _maps(files: list[Path]) -> Any:
    return maps_of_files(files, lambda path: npy_size(path)[:2], read_npy)


def _cameras(files: list[Path], memory: int) -> dict[str, Any]:
    """Return poses (N, 4, 4) camera-to-world and intrinsics (N, 3, 3)."""
    import numpy as np

    from airzoo_bench.formats.arrays import check_fields, numbers
    from airzoo_bench.formats.npz import NpzFile

    found: dict[str, list[Any]] = {"pose": [], "intrinsics": []}
    for path in files:
        file = NpzFile(path, memory)
        check_fields(file, ("pose", "intrinsics"), ("pose", "intrinsics"), "pose and intrinsics")
        for name, side in (("pose", 4), ("intrinsics", 3)):
            value = numbers(file, name, (side, side)).astype(np.float64)
            if value.shape != (side, side):
                raise PredictionError(
                    f"field '{name}' has shape {value.shape}",
                    where=path,
                    expected=f"({side}, {side})",
                )
            found[name].append(value)
    return {name: np.stack(values) for name, values in found.items()}


CUT3R = Cut3r()
