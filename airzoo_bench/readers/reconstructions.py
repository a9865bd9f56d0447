"""Methods that write maps of views, or a COLMAP model: their files, and what the arrays mean."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import readable
from airzoo_bench.formats.arrays import numbers
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.formats.npz import Budget, NpzFile
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import unit_quaternion_to_matrix
from airzoo_bench.readers import pose_files, scenes
from airzoo_bench.readers.frames import frame_files, gather_maps, read_fields
from airzoo_bench.reconstruction.predictions import ScenePrediction, read_image_poses

_LONG_SIDES = (504, 512, 518)  # of images as MapAnything sees them


class _Streaming(scenes.Layout):
    """A streaming run of Depth Anything 3: poses and intrinsics as text, and an npz a frame.

    The poses are written last, so that frames without them are those of a run that did not end.
    """

    said = ("camera_poses.txt camera-to-world, axes of OpenCV", *scenes.CENTRES_AND_SIZE)

    def sure(self, place: Path) -> float:
        frames = place / "results_output"
        texts = [(place / name).is_file() for name in ("camera_poses.txt", "intrinsic.txt")]
        return 0.9 * (all(texts) or any(frames.glob("frame_*.npz")))

    def read(self, output: scenes.SceneOutput, memory: int) -> ScenePrediction:
        place = output.place
        poses = self._table(place / "camera_poses.txt", 16).reshape(-1, 4, 4)
        focal = self._table(place / "intrinsic.txt", 4)
        files = frame_files(place / "results_output", r"frame_(\d{1,9})\.npz", range(len(poses)))
        matrices = np.tile(np.eye(3), (len(focal), 1, 1))
        matrices[:, (0, 1, 0, 1), (0, 1, 2, 2)] = focal
        fields: dict[str, Any] = {"intrinsics": matrices, "extrinsics": scenes.invert_poses(poses)}
        for name in ("depth", "conf"):
            fields[name] = gather_maps(files, lambda path: read_fields(path, (name,), memory)[0])  # noqa: B023
        return scenes.scene_of(place, Budget(memory), fields, output.view_names())

    def _table(self, path: Path, columns: int) -> Floats:
        """Read lines with equal counts of numbers."""
        with readable(path, f"no text of {columns} numbers a line", fix="copy the whole folder"):
            return np.loadtxt(path, ndmin=2).reshape(-1, columns)


@dataclass(frozen=True)
class _Model(scenes.Layout):
    """A binary model, `below` a scene's folder."""

    knows: Callable[[Path], bool]
    below: str = "sparse"
    said = (
        "poses world-to-camera, quaternions w x y z, axes of OpenCV",
        "points of points3D.bin; 2D points and intrinsics are not read",
    )

    def sure(self, place: Path) -> float:
        return 0.9 * (pose_files.is_model(place / self.below) and self.knows(place / self.below))

    def order(self, output: scenes.SceneOutput) -> str:
        return "images by their names in the model"

    def read(self, output: scenes.SceneOutput, memory: int) -> ScenePrediction:
        folder, budget = output.place / self.below, Budget(memory)
        path, cloud = folder / "images.bin", folder / "points3D.bin"
        names, poses = pose_files.read_images(path, budget)
        rotation = pose_files.rotations_of(path, poses[:, :4], names)
        fields = {
            "image_names": np.array(output.photos(names), dtype=str),
            "extrinsics": np.concatenate([rotation, poses[:, 4:, None]], axis=2),
        }
        images, dtype = (
            read_image_poses(scenes.MadeArrays(path, budget, fields), len(names)),
            np.dtype("f8"),
        )
        count = pose_files.count_points(cloud)
        points = FileCloud(
            cloud, "COLMAP", count, lambda most: pose_files.read_points(cloud, most), dtype
        )
        return ScenePrediction(points, images)


def _is_of_mapanything(folder: Path) -> bool:
    """Whether cameras have the image size that MapAnything sees, and points.ply is there."""
    sizes = {size for _, size, _ in pose_files.first_cameras(folder)}
    has_points = (folder / "points.ply").is_file()
    return has_points and len(sizes) == 1 and max(sizes.pop()) in _LONG_SIDES


def _is_of_vggt(folder: Path) -> bool:
    """Whether all principal points are in the middle, and points.ply is there."""
    cameras = pose_files.first_cameras(folder)
    centred = bool(cameras)
    for model, (width, height), parameters in cameras:
        first = 1 if model in (0, 2, 3) else 2
        centred &= parameters[first : first + 2] == (width / 2, height / 2)
    return centred and (folder / "points.ply").is_file() and not _is_of_mapanything(folder)


def _is_of_depth_anything_3(folder: Path) -> bool:
    """Whether there is a pinhole camera an image, with the files of newer versions of COLMAP."""
    cameras = pose_files.first_cameras(folder)
    new = all((folder / name).is_file() for name in ("rigs.bin", "frames.bin"))
    return new and len(cameras) > 1 and all(model == 1 for model, _, _ in cameras)


# --- methods ---

_DEPTH_OR_POINTS = {"depth": "depth", "world_points": "world_points"}


def _decode_poses(file: NpzFile, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
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


VGGT = scenes.SceneReader(
    "depth maps of VGGT",
    "predictions.npz with depth or world_points, and pose_enc or their own confidence",
    ("VGGT",),
    scenes.ViewArrays(
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
        cameras=_decode_poses,
        said=(
            "depth is read, and world_points only where there is none",
            "extrinsic world-to-camera, axes of OpenCV",
            *scenes.CENTRES_AND_SIZE,
        ),
    ),
)
VGGT_COLMAP = scenes.SceneReader(
    "COLMAP models of VGGT",
    "sparse/ with points.ply, whose cameras all have their principal point in the middle",
    ("VGGT",),
    _Model(_is_of_vggt),
)
MAPANYTHING = scenes.SceneReader(
    "depth maps or COLMAP models of MapAnything",
    "predictions.npz with depth, extrinsic and final_mask; or sparse/ with points.ply and cameras "
    "of the size that the network sees",
    ("MapAnything",),
    _Model(_is_of_mapanything),
    scenes.ViewArrays(
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
            *scenes.CENTRES_AND_SIZE,
        ),
    ),
)


DEPTH_ANYTHING_3 = scenes.SceneReader(
    "depth maps of Depth Anything 3",
    "results.npz with depth, extrinsics, intrinsics and no names, in exports/; camera_poses.txt "
    "with results_output/; or a COLMAP model with a camera an image",
    ("Depth Anything 3",),
    scenes.ViewArrays(
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
        said=("extrinsics world-to-camera, axes of OpenCV", *scenes.CENTRES_AND_SIZE),
    ),
    _Streaming(),
    _Model(_is_of_depth_anything_3, below="."),
)


DUST3R = scenes.SceneReader(
    "point maps of DUSt3R or MASt3R",
    "npz with pts3d and poses, as the recipe's lines save them",
    ("DUSt3R", "MASt3R"),
    scenes.ViewArrays(
        maps={"pts3d": "world_points"},
        confidence={"pts3d": "conf"},
        needed=({"pts3d"}, {"poses"}),
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
)
