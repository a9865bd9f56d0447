"""MapAnything: ``predictions.npz`` of its gradio app, or the folder that demo_colmap.py writes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.files import npz_fields
from airzoo_bench.readers.colmap_models import first_cameras, is_model, model_scene
from airzoo_bench.readers.scene_folders import ScenePlaces, SceneReader
from airzoo_bench.readers.view_files import (
    ViewFields,
    in_photo_order,
    read_views,
    view_names,
)

if TYPE_CHECKING:
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = ["MAPANYTHING", "MapAnything", "is_processed_model"]

_FIELDS = ViewFields(
    intrinsics="intrinsic",
    extrinsics="extrinsic",
    confidence={"depth": "conf", "world_points": "conf"},
    mask="final_mask",
    camera_to_world=True,
)
_NEEDED = {"extrinsic", "intrinsic", "final_mask"}
_UNTOUCHED = ("images",)
_LONG_SIDES = (504, 512, 518)
"""Of the images as the network sees them, at the resolutions that it is trained for."""


class MapAnything(SceneReader):
    """Reads depth maps with cameras, or the points and poses of a model."""

    title = "depth maps or COLMAP models of MapAnything"
    layout = (
        "predictions.npz with depth, extrinsic and final_mask; or sparse/ with points.ply and "
        "cameras of the size that the network sees"
    )
    methods = ("MapAnything",)

    def sure_of(self, place: Path) -> float:
        """Look at the names of the fields, or at the cameras of the model."""
        names = npz_fields(_file(place))
        if names >= _NEEDED and names & {"depth", "world_points"}:
            return 0.9
        return 0.9 if is_processed_model(place / "sparse") else 0.0

    def conventions(self, scenes: ScenePlaces) -> tuple[str, ...]:
        """See `SceneReader.conventions`."""
        place = next(iter(scenes.places.values()))
        if is_model(place / "sparse"):
            return (
                "poses world-to-camera, quaternions w x y z, axes of OpenCV",
                "points of points3D.bin; intrinsics, which are of the processed images, are not "
                "read",
            )
        return (
            "depth, intrinsic and extrinsic are read where final_mask is set; world_points only "
            "where there is no depth",
            "extrinsic camera-to-world, axes of OpenCV",
            "pixel centres are integers: the principal point is shifted by half a pixel",
            "intrinsic of the images as the network sees them",
            in_photo_order(scenes, _file(place).parent / "images"),
        )

    def read_scene(self, scenes: ScenePlaces, place: Path, memory: int) -> ScenePrediction:
        """See `SceneReader.read_scene`."""
        from airzoo_bench.formats.npz import NpzFile

        if is_model(place / "sparse"):
            return model_scene(scenes, place, place / "sparse", memory)
        file = NpzFile(_file(place), memory, _UNTOUCHED)
        return read_views(file, _FIELDS, view_names(scenes, place, file.path.parent / "images"))


def is_processed_model(folder: Path) -> bool:
    """Whether a model's cameras are of images as MapAnything sees them, with points.ply beside."""
    if not (is_model(folder) and (folder / "points.ply").is_file()):
        return False
    sizes = {camera.size for camera in first_cameras(folder)[1]}
    return len(sizes) == 1 and max(next(iter(sizes))) in _LONG_SIDES


def _file(place: Path) -> Path:
    return place / "predictions.npz" if place.is_dir() else place


MAPANYTHING = MapAnything()
