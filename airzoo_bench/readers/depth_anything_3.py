"""Depth Anything 3: results.npz, a streaming run's folder, or a COLMAP model at folder level."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import npz_fields
from airzoo_bench.readers.colmap_models import first_cameras, is_model, model_scene
from airzoo_bench.readers.depth_anything_3_streaming import is_streaming, streaming_scene
from airzoo_bench.readers.scene_folders import ScenePlaces, SceneReader
from airzoo_bench.readers.view_files import (
    ViewFields,
    in_photo_order,
    read_views,
    view_names,
)

if TYPE_CHECKING:
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = ["DEPTH_ANYTHING_3", "DepthAnything3"]

_FIELDS = ViewFields(
    intrinsics="intrinsics", extrinsics="extrinsics", confidence={"depth": "conf"}, maps=("depth",)
)
_NEEDED = {"depth", "extrinsics", "intrinsics"}
_KNOWN = _NEEDED | {"conf", "image"}
_META = {"extrinsics", "intrinsics", "image_files"}
_EXPORTS = tuple(
    Path(home, kind, "results.npz")
    for home in ("exports", "unposed/exports", ".")
    for kind in ("mini_npz", "npz")
)
"""Where results lie in the folder of a scene; the first has two more decimals than the second."""
_CANONICAL = Path("results.npz")
_NAMES_FROM_META = (
    "python -c \"import numpy as np; print(*np.load('{}', allow_pickle=True)['image_files'], "
    "sep='\\n')\" > names.txt, and give the list with --names names.txt"
)
_FIX_GLB = "write depth and cameras too: model.inference(..., export_format='mini_npz')"


class DepthAnything3(SceneReader):
    """Reads depth maps with cameras; points and poses of models and of streaming runs."""

    title = "depth maps of Depth Anything 3"
    layout = (
        "results.npz with depth, extrinsics, intrinsics and no names, in exports/; "
        "camera_poses.txt with results_output/; or a COLMAP model with a camera an image"
    )
    methods = ("Depth Anything 3",)

    def sure_of(self, place: Path) -> float:
        """Look at the names of fields and files, and at the cameras of a model."""
        if _results(place) is not None or is_streaming(place) or npz_fields(place) == _META:
            return 0.9
        return 0.8 if _is_model(place) or _is_glb(place) else 0.0

    def sure_within(self, place: Path) -> float:
        """Leave to the suite's own layout what it reads: results.npz alone in a scene's folder."""
        results = _results(place)
        own = results is not None and (place.is_file() or results == place / _CANONICAL)
        return 0.2 if own else self.sure_of(place)

    def conventions(self, scenes: ScenePlaces) -> tuple[str, ...]:
        """See `SceneReader.conventions`."""
        place = next(iter(scenes.places.values()))
        if _is_model(place):
            return (
                "poses world-to-camera, quaternions w x y z, axes of OpenCV",
                "points of points3D.bin; 2D points and intrinsics are not read",
            )
        poses = "camera_poses.txt camera-to-world"
        if not is_streaming(place):
            poses = "extrinsics world-to-camera"
        return (
            f"{poses}, axes of OpenCV",
            "pixel centres are integers: the principal point is shifted by half a pixel",
            "intrinsics of the images as the network sees them",
            in_photo_order(scenes),
        )

    def read_scene(self, scenes: ScenePlaces, place: Path, memory: int) -> ScenePrediction:
        """See `SceneReader.read_scene`."""
        from airzoo_bench.formats.npz import NpzFile

        results = _results(place)
        if results is not None:
            file = NpzFile(results, memory, ("image",))
            return read_views(file, _FIELDS, view_names(scenes, place))
        if is_streaming(place):
            return streaming_scene(place, memory, view_names(scenes, place))
        if _is_model(place):
            return model_scene(scenes, place, place, memory)
        if npz_fields(place) >= _META:
            raise PredictionError(
                "holds 'image_files', the names of the views, as a pickle, which is never loaded",
                where=place,
                expected="results.npz beside it, and a list of names, a line each",
                fix=_NAMES_FROM_META.format(place),
            )
        raise PredictionError(
            "scene.glb is turned, moved to its middle point, thinned to a million points, and has "
            "the cameras draw_points into it",
            where=place,
            expected="exports/mini_npz/results.npz",
            fix=_FIX_GLB,
        )


def _is_results(path: Path) -> bool:
    names = npz_fields(path)
    return bool(names) and _NEEDED <= names <= _KNOWN


def _results(place: Path) -> Path | None:
    """Return the results of a scene: a file, or where exports lie in its folder."""
    if place.is_file():
        return place if _is_results(place) else None
    files = (place / one for one in (*_EXPORTS, _CANONICAL))
    return next((one for one in files if _is_results(one)), None)


def _is_model(place: Path) -> bool:
    """Whether a folder is a model of pinhole cameras, one an image, that newer versions wrote."""
    if not (
        is_model(place) and (place / "rigs.bin").is_file() and (place / "frames.bin").is_file()
    ):
        return False
    count, cameras = first_cameras(place)
    return count > 1 and all(camera.model == 1 for camera in cameras)


def _is_glb(place: Path) -> bool:
    beside = (place / "scene.jpg").is_file() or (place / "depth_vis").is_dir()
    return beside and (place / "scene.glb").is_file()


DEPTH_ANYTHING_3 = DepthAnything3()
