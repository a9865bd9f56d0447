"""Methods of reconstruction: what their files are called, and what their arrays mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from airzoo_bench.core.files import first_bytes
from airzoo_bench.formats.arrays import numbers
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import unit_quaternion_to_matrix
from airzoo_bench.readers.frames import Cut3rDemo, PosesAndPoints, Streaming
from airzoo_bench.readers.models import (
    Model,
    is_of_depth_anything_3,
    is_of_mapanything,
    is_of_vggt,
)
from airzoo_bench.readers.scenes import Refused, SceneReader
from airzoo_bench.readers.trajectories import CamerasAlone, CloudWithTrajectory
from airzoo_bench.readers.views import CENTRES_AND_SIZE, ViewArrays

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
    Streaming(),
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
    Cut3rDemo(),
    CamerasAlone("pred_traj.txt", "demo.py --output_dir writes depth maps, too"),
)
VGGT_SLAM = SceneReader(
    "poses and point maps of VGGT-SLAM",
    "poses.txt (number, place, quaternion) and poses_logs/<number>.npz (pointcloud, mask)",
    ("VGGT-SLAM",),
    PosesAndPoints(),
)
CLOUD_TRAJECTORY = SceneReader(
    "a cloud with a trajectory of TUM or KITTI",
    "a folder a scene with one cloud and one text of 8 (TUM) or 12 (KITTI) numbers a row",
    ("SLAM systems", "evo"),
    CloudWithTrajectory(),
)
