"""VGGT: the ``sparse/`` that demo_colmap.py writes beside the images of a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions
from airzoo_bench.readers.colmap_models import first_cameras, is_model, model_scene
from airzoo_bench.readers.mapanything import is_processed_model
from airzoo_bench.readers.scene_folders import find_scenes, most_sure

if TYPE_CHECKING:
    from airzoo_bench.reconstruction.depth_map_files import ScenePrediction

__all__ = ["VGGT_COLMAP", "VggtColmap"]


class VggtColmap(Reader):
    """Reads points and poses; 2D points of photos that are not square are wrong in such files."""

    track = "reconstruction"
    title = "COLMAP models of VGGT"
    layout = "sparse/ with points.ply, whose cameras all have their principal point in the middle"
    methods = ("VGGT",)

    def recognise(self, path: Path) -> float:
        """Look at the cameras of the model."""
        return most_sure(path, _sure, _sure)

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """List the scenes; each is read when it is scored."""
        scenes = find_scenes(path, reading, lambda place: is_model(place / "sparse"))

        def read_scene(place: Path, memory: int) -> ScenePrediction:
            return model_scene(scenes, place, place / "sparse", memory)

        conventions = (
            "poses world-to-camera, quaternions w x y z, axes of OpenCV",
            "points of points3D.bin; 2D points and intrinsics are not read",
            "images by their file names, since the model holds no more of their paths",
        )
        return ReadPredictions(scenes.predictions(read_scene), conventions)


def _sure(place: Path) -> float:
    folder = place / "sparse"
    if not (is_model(folder) and (folder / "points.ply").is_file()) or is_processed_model(folder):
        return 0.0
    cameras = first_cameras(folder)[1]
    return 0.9 if cameras and all(camera.is_centred for camera in cameras) else 0.0


VGGT_COLMAP = VggtColmap()
