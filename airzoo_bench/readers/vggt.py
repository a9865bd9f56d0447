"""VGGT: ``predictions.npz`` of demo_gradio.py, or the model's own output, saved."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.files import npz_fields
from airzoo_bench.readers.scene_folders import ScenePlaces, SceneReader
from airzoo_bench.readers.view_files import (
    ViewFields,
    in_photo_order,
    read_views,
    view_names,
)

if TYPE_CHECKING:
    from airzoo_bench.formats.npz import NpzFile
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = ["VGGT", "Vggt"]

_FIELDS = ViewFields(
    intrinsics="intrinsic",
    extrinsics="extrinsic",
    confidence={"depth": "depth_conf", "world_points": "world_points_conf"},
)
_MAPS = {"depth", "world_points"}
_OWN = {"pose_enc", "depth_conf", "world_points_conf"}
_UNTOUCHED = ("pose_enc_list", "images", "world_points_from_depth", "track", "vis", "conf")
"""Members that no score needs; the first is a pickle in most versions."""


class Vggt(SceneReader):
    """Reads depth maps with cameras; the model's point maps only where it wrote no depth."""

    title = "depth maps of VGGT"
    layout = "predictions.npz with depth or world_points, and pose_enc or their own confidence"
    methods = ("VGGT",)

    def sure_of(self, place: Path) -> float:
        """Look at the names of the fields."""
        names = npz_fields(_file(place))
        cameras = "pose_enc" in names or {"extrinsic", "intrinsic"} <= names
        own = names & _MAPS and names & _OWN and cameras
        return 0.9 if own and "final_mask" not in names else 0.0

    def conventions(self, scenes: ScenePlaces) -> tuple[str, ...]:
        """See `SceneReader.conventions`."""
        place = next(iter(scenes.places.values()))
        return (
            "depth, intrinsic and extrinsic are read, and world_points only where there is no "
            "depth",
            "extrinsic world-to-camera, axes of OpenCV",
            "pixel centres are integers: the principal point is shifted by half a pixel",
            "intrinsic of the images as the network sees them",
            in_photo_order(scenes, _file(place).parent / "images"),
        )

    def read_scene(self, scenes: ScenePlaces, place: Path, memory: int) -> ScenePrediction:
        """See `SceneReader.read_scene`."""
        from airzoo_bench.formats.npz import NpzFile

        file = NpzFile(_file(place), memory, _UNTOUCHED)
        made: dict[str, Callable[[], Any]] = {}
        if not {"extrinsic", "intrinsic"} <= file.names():
            made = {
                "intrinsics": lambda: _decoded(file)[0],
                "extrinsics": lambda: _decoded(file)[1],
            }
        names = view_names(scenes, place, file.path.parent / "images")
        return read_views(file, _FIELDS, names, made)


def _file(place: Path) -> Path:
    return place / "predictions.npz" if place.is_dir() else place


def _decoded(file: NpzFile) -> tuple[Any, Any]:
    """Decode pose_enc: translation, quaternion x y z w (world-to-camera), fields of view y, x."""
    import numpy as np

    from airzoo_bench.formats.arrays import numbers
    from airzoo_bench.geometry.poses import unit_quaternion_to_matrix
    from airzoo_bench.readers.view_files import as_maps

    shape = (None, 9) if len(file.entries["pose_enc"].shape) == 2 else (1, None, 9)
    code = numbers(file, "pose_enc", shape).astype(np.float64).reshape(-1, 9)
    name = "depth" if "depth" in file.names() else "world_points"
    height, width = as_maps(file, name, 3 + (name != "depth")).shape[1:3]
    with np.errstate(all="ignore"):  # NaN and zeros are refused by their matrices
        quaternion = code[:, (6, 3, 4, 5)] / np.linalg.norm(code[:, 3:7], axis=1, keepdims=True)
        focal = np.array((width, height)) / 2.0 / np.tan(code[:, (8, 7)] / 2.0)
    rotation = unit_quaternion_to_matrix(quaternion)
    intrinsics = np.tile(np.eye(3), (len(code), 1, 1))
    intrinsics[:, (0, 1), (0, 1)] = focal
    intrinsics[:, :2, 2] = np.array((width, height)) / 2.0
    return intrinsics, np.concatenate([rotation, code[:, :3, None]], axis=2)


VGGT = Vggt()
