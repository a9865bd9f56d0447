"""VGGT: the ``sparse/`` that demo_colmap.py writes beside the images of a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.readers.colmap_models import first_cameras, is_model, model_scene
from airzoo_bench.readers.mapanything import is_processed_model
from airzoo_bench.readers.scene_folders import ScenePlaces, SceneReader

if TYPE_CHECKING:
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = ["VGGT_COLMAP", "VggtColmap"]


class VggtColmap(SceneReader):
    """Reads points and poses; 2D points of photos that are not square are wrong in such files."""

    title = "COLMAP models of VGGT"
    layout = "sparse/ with points.ply, whose cameras all have their principal point in the middle"
    methods = ("VGGT",)

    def sure_of(self, place: Path) -> float:
        """Look at the cameras of the model."""
        folder = place / "sparse"
        if not (self.is_scene(place) and (folder / "points.ply").is_file()):
            return 0.0
        if is_processed_model(folder):
            return 0.0
        cameras = first_cameras(folder)[1]
        return 0.9 if cameras and all(camera.is_centred for camera in cameras) else 0.0

    def is_scene(self, place: Path) -> bool:
        """Say whether there is a model: one whose cameras say less is read when it is asked for."""
        return is_model(place / "sparse")

    def conventions(self, _: ScenePlaces) -> tuple[str, ...]:
        """See `SceneReader.conventions`."""
        return (
            "poses world-to-camera, quaternions w x y z, axes of OpenCV",
            "points of points3D.bin; 2D points and intrinsics are not read",
            "images by their file names, since the model holds no more of their paths",
        )

    def read_scene(self, scenes: ScenePlaces, place: Path, memory: int) -> ScenePrediction:
        """See `SceneReader.read_scene`."""
        return model_scene(scenes, place, place / "sparse", memory)


VGGT_COLMAP = VggtColmap()
