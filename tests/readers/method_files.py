"""Files as methods write them, made from true descriptors of a place and true views of scenes."""

from __future__ import annotations

import re
import shutil
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from scipy.spatial.transform import Rotation

import airzoo_bench as ab
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from tests.reconstruction.world import (
    ORIGIN,
    PHOTO_SIZE,
    World,
    camera_poses,
    exact_depth,
    make_world,
    matrix_of_maps,
    replace_cloud,
)
from tests.support import MadeScene, made_protocol, write_benchmark

PROTOCOL = "made-retrieval"
FOLDERS = "/data/made"
_DIMENSIONS = 24


def made_scenes() -> list[MadeScene]:
    """Return two scenes: every query q has the tiles q and q + 1 as positives."""
    return [
        MadeScene("east", [[q, q + 1] for q in range(6)], 12),
        MadeScene("west", [[q, q + 1] for q in range(4)], 8),
    ]


@dataclass(frozen=True)
class Place:
    """Scenes with float32 descriptors of unit length, in the order of the ids.

    `noise` 0 makes every query most like its positives.
    """

    scenes: list[MadeScene] = field(default_factory=made_scenes)
    noise: float = 0.0

    def descriptors(self, scene: MadeScene) -> tuple[Any, Any]:
        """Return those of queries and of tiles."""
        random = np.random.default_rng(len(scene.id) + scene.n_tiles)
        square = random.standard_normal((_DIMENSIONS, _DIMENSIONS))
        tiles = np.linalg.qr(square)[0][: scene.n_tiles]
        queries = np.stack([tiles[found].sum(axis=0) for found in scene.positives])
        queries = queries + self.noise * random.standard_normal(queries.shape)
        queries /= np.linalg.norm(queries, axis=1, keepdims=True)
        return queries.astype(np.float32), tiles.astype(np.float32)

    def every_descriptor(self) -> tuple[Any, Any]:
        pairs = [self.descriptors(scene) for scene in self.scenes]
        return np.concatenate([one for one, _ in pairs]), np.concatenate([one for _, one in pairs])

    def ranked(self, scene: MadeScene) -> tuple[Any, Any]:
        """Return tile numbers, best first, and their similarities, of each query."""
        queries, tiles = (one.astype(np.float64) for one in self.descriptors(scene))
        scores = -((queries[:, None] - tiles[None]) ** 2).sum(axis=2)
        order = np.argsort(-scores, axis=1)
        return order, np.take_along_axis(scores, order, axis=1)

    def canonical(self, path: Path) -> Path:
        """Write the suite's own file of the same descriptors."""
        queries, tiles = self.every_descriptor()
        np.savez(
            path,
            protocol=np.array(PROTOCOL),
            query_ids=np.array([one for scene in self.scenes for one in scene.query_ids]),
            gallery_ids=np.array([one for scene in self.scenes for one in scene.tile_ids]),
            query_descriptors=queries,
            gallery_descriptors=tiles,
        )
        return path

    def prepare(self, root: Path) -> Path:
        """Write the benchmark folder below a data root."""
        write_benchmark(root / "made", made_protocol(self.scenes), self.scenes)
        return root


def tile_file(folder: str, scene: MadeScene, number: int) -> str:
    """Return where `prepare --tiles files` would have written a tile."""
    return f"{folder}/scenes/{scene.id}/retrieval/tiles/t{number:05d}.png"


def photo_file(folder: str, scene: MadeScene, number: int) -> str:
    return f"{folder}/{scene.id}/photos/q{number:05d}.jpg"


def scored(path: Path, data: Path, **given: Any) -> ab.Result:
    return ab.evaluate(path, protocol=PROTOCOL, data=data, **given)


def perfect(result: Any) -> bool:
    return bool(result.overall["recall@1"] == 1.0 and result.overall["map"] == 1.0)


# --- VPR-methods-evaluation: main.py with --save_descriptors, as of April 2026 ---


def write_log(folder: Path, scene: MadeScene, home: str = FOLDERS, **changes: Any) -> None:
    """Write info.log, with the arguments as Python prints them."""
    counts = changes.pop("counts", (len(scene.positives), scene.n_tiles))
    arguments: dict[str, Any] = {
        "method": "salad",
        "descriptors_dimension": 8448,
        "database_folder": str(Path(tile_file(home, scene, 0)).parent),
        "queries_folder": str(Path(photo_file(home, scene, 0)).parent),
        "save_only_wrong_preds": False,
        "use_labels": False,
    } | changes
    said = ", ".join(f"{key}={value!r}" for key, value in arguments.items())
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "info.log").write_text(
        "2026-11-22 19:00:00 main.py --method salad --save_descriptors\n"
        f"2026-11-22 19:00:00 Arguments: Namespace({said})\n"
        f"2026-11-22 19:00:01 Testing on < #queries: {counts[0]}; #database: {counts[1]} >\n"
    )


def write_images(home: str, scene: MadeScene) -> None:
    """Write the folders that the log names, with empty files for images."""
    files = [tile_file(home, scene, number) for number in range(scene.n_tiles)]
    files += [photo_file(home, scene, number) for number in range(len(scene.positives))]
    for file in map(Path, files):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()


def write_descriptors(folder: Path, place: Place, scene: MadeScene) -> None:
    queries, tiles = place.descriptors(scene)
    np.save(folder / "queries_descriptors.npy", queries)
    np.save(folder / "database_descriptors.npy", tiles)


def write_lists(folder: Path, place: Place, scene: MadeScene, *, labels: bool = False) -> None:
    """Write preds/NNN.txt as `visualizations.save_file_with_paths` does."""
    (folder / "preds").mkdir(parents=True)
    change = labelled if labels else str
    for query, tiles in enumerate(place.ranked(scene)[0].tolist()):
        photo = change(photo_file(FOLDERS, scene, query))
        found = "\n".join(change(tile_file(FOLDERS, scene, one)) for one in tiles[:8])
        content = ["Query path:", photo + "\n", "Predictions paths:", found + "\n"]
        if labels:
            content += ["Positives paths:", change(tile_file(FOLDERS, scene, 0)) + "\n"]
        (folder / "preds" / f"{query:03d}.txt").write_text("\n".join(content))


def labelled(path: str) -> str:
    """Put a position before the name of an image, falling from image to image."""
    place = Path(path)
    east = 600_000 - int(place.stem[1:])
    return str(place.with_name(f"@{east}.00@3100000.00@{place.stem}@{place.suffix}"))


def write_vpr(folder: Path, place: Place) -> Path:
    """Write a log folder for each scene."""
    for scene in place.scenes:
        log = folder / "logs" / scene.id / "2026-11-22_19-00-00"
        write_log(log, scene)
        write_descriptors(log, place, scene)
    return folder / "logs"


def save_mat(path: Path, queries: tuple[Any, list[str]], gallery: tuple[Any, list[str]]) -> Path:
    """Write the dictionary that test.py of University-1652 makes."""
    result: dict[str, Any] = {}
    for kind, (rows, paths) in (("gallery", gallery), ("query", queries)):
        result[f"{kind}_f"] = rows
        result[f"{kind}_label"] = [int(Path(one).parent.name) for one in paths]
        result[f"{kind}_path"] = paths
    scipy.io.savemat(path, result)
    return path


# --- reconstruction: true views, and scenes by the rules of each layout ---

Array = np.ndarray[Any, Any]
SCENES = ("yard", "lot")
_SCALE = 1 / 32.0
_SEEN_BY_MAPANYTHING = (518, 392)


@dataclass(frozen=True)
class Views:
    """True views of a scene; the world is the first camera's frame, shrunk; centres are integers.

    Names are sorted; `depth` (N, H, W), `intrinsics` (N, 3, 3), `w2c` (N, 4, 4).
    """

    names: list[str]
    depth: Array
    intrinsics: Array
    w2c: Array

    @property
    def c2w(self) -> Array:
        return np.linalg.inv(self.w2c)

    @property
    def points(self) -> Array:
        """Points (N, H, W, 3) of the world by pinhole and pose: no code of the suite."""
        height, width = self.depth.shape[1:]
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        pixels = np.stack([u, v, np.ones_like(u)], axis=-1).astype(float)
        rays = np.einsum("nij,hwj->nhwi", np.linalg.inv(self.intrinsics), pixels)
        turned = np.einsum("nij,nhwj->nhwi", self.c2w[:, :3, :3], rays * self.depth[..., None])
        found: Array = turned + self.c2w[:, None, None, :3, 3]
        return found

    @property
    def seen(self) -> Array:
        found: Array = self.points[self.depth > 0]
        return found

    def take(self, rows: Sequence[int]) -> Views:
        names, some = [self.names[row] for row in rows], [*rows]
        return Views(names, self.depth[some], self.intrinsics[some], self.w2c[some])


def _xyzw(matrices: Array) -> Array:
    found: Array = Rotation.from_matrix(matrices[:, :3, :3]).as_quat()
    return found


def true_views(world: World, scene: str) -> Views:
    poses = camera_poses(scene)
    rotation, centres = poses.rotation, (poses.centres - ORIGIN) * _SCALE
    first = rotation[0]
    w2c = np.tile(np.eye(4), (len(poses), 1, 1))
    w2c[:, :3, :3] = rotation @ first.T
    w2c[:, :3, 3] = -np.einsum("nij,nj->ni", w2c[:, :3, :3], (centres - centres[0]) @ first.T)
    K = matrix_of_maps()
    K[:2, 2] -= 0.5
    depth = exact_depth(poses, boxed=scene == "yard") * _SCALE
    return Views(world.images(scene), depth, np.tile(K, (len(poses), 1, 1)), w2c)


def make_views_world(root: Path) -> World:
    """Make a world whose true clouds are what its views see, so that nothing is missed."""
    made = make_world(root)
    for scene in SCENES:
        poses = camera_poses(scene)
        seen = true_views(made, scene).seen
        replace_cloud(made, scene, seen @ poses.rotation[0] / _SCALE + poses.centres[0])
    return made


# --- an npz a scene ---


def vggt_fields(views: Views) -> dict[str, Any]:
    """What VGGT's demo_gradio.py saves."""
    count, height, width = views.depth.shape
    trust = np.full(views.depth.shape, 7.0, "f4")
    focal = views.intrinsics[:, (1, 0), (1, 0)]
    fov = 2 * np.arctan(np.array((height, width)) / 2 / focal)
    coded = np.concatenate([views.w2c[:, :3, 3], _xyzw(views.w2c), fov], axis=1)
    return {
        "pose_enc": coded.astype("f4"),
        "pose_enc_list": np.array(None, dtype=object),  # pickled, as the demo leaves it
        "depth": views.depth[..., None].astype("f4"),
        "depth_conf": trust,
        "world_points": views.points.astype("f4"),
        "world_points_conf": trust,
        "images": np.zeros((count, 3, height, width), "f4"),
        "extrinsic": views.w2c[:, :3].astype("f4"),
        "intrinsic": views.intrinsics.astype("f4"),
        "world_points_from_depth": views.points,
    }


def mapanything_fields(views: Views) -> dict[str, Any]:
    """What MapAnything's gradio app saves."""
    seen = views.depth > 0
    # Where the mask is False the method leaves depths of its own, which it takes for none.
    depth = np.where(seen, views.depth, 3.0)
    return {
        "extrinsic": views.c2w.astype("f4"),
        "intrinsic": views.intrinsics.astype("f4"),
        "world_points": views.points.astype("f4"),
        "conf": np.full(views.depth.shape, 1.5, "f4"),
        "depth": depth[..., None].astype("f4"),
        "images": np.zeros((*views.depth.shape, 3), "f4"),
        "final_mask": seen,
    }


def da3_fields(views: Views, digits: int = 8) -> dict[str, Any]:
    return {
        "depth": np.round(views.depth.astype("f4"), digits),
        "conf": np.round(np.full(views.depth.shape, 1.25, "f4"), 2),
        "extrinsics": views.w2c[:, :3].astype("f4"),
        "intrinsics": views.intrinsics.astype("f4"),
    }


def dust3r_fields(views: Views) -> dict[str, Any]:
    """What the lines of docs/recipes/reconstruction.md save."""
    points = np.where(views.depth[..., None] > 0, views.points, np.nan)
    return {
        "pts3d": points.astype("f4"),
        "poses": views.c2w.astype("f4"),
        "focals": views.intrinsics[:, :1, 0].astype("f4"),
        "conf": np.full(views.depth.shape, 7.0, "f4"),
        "names": np.array(views.names),
    }


def write_fields(path: Path, given: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{name: value for name, value in given.items() if value is not None})


def touch_images(folder: Path, views: Views) -> None:
    folder.mkdir()
    for name in views.names:
        (folder / name).touch()


def vggt(place: Path, views: Views, **changes: Any) -> None:
    write_fields(place / "predictions.npz", vggt_fields(views) | changes)
    touch_images(place / "images", views)
    (place / "glbscene_50_All.glb").write_bytes(b"glTF")


def mapanything(place: Path, views: Views, **changes: Any) -> None:
    write_fields(place / "predictions.npz", mapanything_fields(views) | changes)
    touch_images(place / "images", views)


def da3(place: Path, views: Views, kind: str = "mini_npz") -> None:
    given = da3_fields(views, 8 if kind == "mini_npz" else 6)
    if kind == "npz":
        given["image"] = np.zeros((*views.depth.shape, 3), np.uint8)
    write_fields(place / "exports" / kind / "results.npz", given)


def dust3r(place: Path, views: Views, **changes: Any) -> None:
    write_fields(place / "scene.npz", dust3r_fields(views) | changes)


# --- a file a frame ---


def cut3r(place: Path, views: Views) -> None:
    """Write the folder of demo.py."""
    for name in ("depth", "conf", "camera"):
        (place / name).mkdir(parents=True)
    for row, depth in enumerate(views.depth):
        np.save(place / "depth" / f"{row:06d}.npy", depth.astype("f4"))
        np.save(place / "conf" / f"{row:06d}.npy", np.full(depth.shape, 7.0, "f4"))
        camera = {"pose": views.c2w[row], "intrinsics": views.intrinsics[row]}
        write_fields(
            place / "camera" / f"{row:06d}.npz", {k: v.astype("f4") for k, v in camera.items()}
        )


def cut3r_trajectory(place: Path, views: Views) -> None:
    """Write ``pred_traj.txt`` of the evaluation of poses."""
    place.mkdir(parents=True)
    rows = np.concatenate([views.c2w[:, :3, 3], _xyzw(views.c2w)[:, [3, 0, 1, 2]]], axis=1)
    lines = [f"{float(n)} {' '.join(map(str, row))}\n" for n, row in enumerate(rows.tolist())]
    (place / "pred_traj.txt").write_text("".join(lines))


def da3_streaming(place: Path, views: Views) -> None:
    (place / "results_output").mkdir(parents=True)
    poses = (" ".join(str(x) for x in pose.flatten()) for pose in views.c2w)
    (place / "camera_poses.txt").write_text("".join(f"{line}\n" for line in poses))
    lenses = (f"{K[0, 0]} {K[1, 1]} {K[0, 2]} {K[1, 2]}\n" for K in views.intrinsics)
    (place / "intrinsic.txt").write_text("".join(lenses))
    for row, depth in enumerate(views.depth.astype("f4")):
        given = {"image": np.zeros((*depth.shape, 3), np.uint8), "depth": depth}
        write_fields(
            place / "results_output" / f"frame_{row}.npz", given | {"conf": np.ones_like(depth)}
        )


def vggt_slam(
    place: Path, views: Views, photos: Sequence[str] | None = None, dense: bool = True
) -> None:
    """Write two submaps of a scene; `photos` are the names that VGGT-SLAM was given."""
    names = photos or [f"{row:06d}.jpg" for row in range(len(views.names))]
    logs, lines, half = place / "poses_logs", [], len(names) // 2
    logs.mkdir(parents=True)
    xyzw = _xyzw(views.c2w)
    for row in (*range(half + 1), *range(half, len(names))):
        number = float(re.findall(r"\d+(?:\.\d+)?", names[row])[0])
        values = np.array([number, *views.c2w[row, :3, 3], *xyzw[row]])
        if row == half and len(lines) == half:
            values[1:4] += 5.0  # a frame that two submaps share: the first one's is another
        lines.append(" ".join(f"{value:.8f}" for value in values) + "\n")
        mask = views.depth[row] > 0
        points = np.where(mask[..., None], views.points[row], 99.0)
        np.savez(logs / f"{number}.npz", pointcloud=points, mask=mask)
    (place / "poses.txt").write_text("".join(lines))
    if not dense:
        shutil.rmtree(logs)


def cloud_trajectory(place: Path, views: Views, kitti: bool = False) -> None:
    place.mkdir(parents=True)
    write_ply(place / "map.ply", Cloud(views.seen))
    if kitti:
        np.savetxt(place / "poses.txt", views.c2w[:, :3].reshape(-1, 12), fmt="%.12g")
        return
    stamps = 1_700_000_000.5 + np.arange(len(views.c2w))
    rows = np.column_stack([stamps, views.c2w[:, :3, 3], _xyzw(views.c2w)])
    np.savetxt(place / "trajectory.txt", rows, fmt="%.12g", header="timestamp tx ty tz q")


# --- COLMAP models, byte by byte as COLMAP's format page describes them ---


def write_model(
    folder: Path, views: Views, size: tuple[int, int] = PHOTO_SIZE, *, tracks: bool = True
) -> None:
    """Write cameras, images and points of true views; each point is seen by its own view."""
    folder.mkdir(parents=True)
    count = len(views.names)
    scale = size[0] / views.depth.shape[2]
    pinhole = (*(views.intrinsics[0, (0, 1), (0, 1)] * scale), size[0] / 2, size[1] / 2)
    cameras = [struct.pack("<IiQQ4d", n + 1, 1, *size, *pinhole) for n in range(count)]
    points, view_of = views.seen.astype("f4").astype(float), np.nonzero(views.depth > 0)[0]
    images, bodies, total = [], [], np.zeros(count, int)
    for number, (point, view) in enumerate(zip(points, view_of, strict=True)):
        body = struct.pack("<Q3d3BdQ", number + 1, *point, 9, 9, 9, -1.0, int(tracks))
        bodies.append(body + struct.pack("<II", view + 1, total[view]) * tracks)
        total[view] += 1
    firsts = np.concatenate([[0], np.cumsum(total)])
    for n, (name, xyzw) in enumerate(zip(views.names, _xyzw(views.w2c), strict=True)):
        quaternion = xyzw[[3, 0, 1, 2]]
        head = struct.pack("<I7dI", n + 1, *quaternion, *views.w2c[n, :3, 3], n + 1)
        # 2D points as VGGT leaves them: of two frames mixed up, far outside the photo.
        pixels = [struct.pack("<ddQ", 44.0, -218.8, firsts[n] + k + 1) for k in range(total[n])]
        used = pixels if tracks else []
        images.append(head + name.encode() + b"\0" + struct.pack("<Q", len(used)) + b"".join(used))
    for file, parts in (("cameras", cameras), ("images", images), ("points3D", bodies)):
        (folder / f"{file}.bin").write_bytes(struct.pack("<Q", len(parts)) + b"".join(parts))


def vggt_colmap(place: Path, views: Views, **options: Any) -> None:
    write_model(place / "sparse", views, **options)
    write_ply(place / "sparse" / "points.ply", Cloud(views.seen))


def mapanything_colmap(place: Path, views: Views) -> None:
    vggt_colmap(place, views, size=_SEEN_BY_MAPANYTHING)
    touch_images(place / "images", views)


def da3_colmap(place: Path, views: Views) -> None:
    """Write a model with the files that newer versions add: a rig an image, of one camera."""
    write_model(place, views)
    count = len(views.names)
    for name in ("rigs", "frames"):
        rows = [struct.pack("<QIIii", 1, n + 1, 1, 0, n + 1) for n in range(count)]
        (place / f"{name}.bin").write_bytes(struct.pack("<Q", count) + b"".join(rows))


# --- both scenes ---


def write(
    scene: Callable[..., None], folder: Path, world: World, *, turned: bool = False, **options: Any
) -> Path:
    """Write the scenes into ``out``, and ``names.txt`` with the photos in their order beside it.

    Views are in the order of the photos, or the other way round.
    """
    names = []
    for one in SCENES:
        views = true_views(world, one)
        views = views.take(range(len(views.names))[::-1]) if turned else views
        scene(folder / "out" / one, views, **options)
        names += [f"{one}/{name}" for name in views.names]
    (folder / "names.txt").write_text("\n".join(names))
    return folder / "out"


def write_yard(scene: Callable[..., None], folder: Path, world: World, **options: Any) -> Path:
    """Write the yard's output alone, in a folder of scenes."""
    scene(folder / "out" / "yard", true_views(world, "yard"), **options)
    return folder / "out"


WRITERS = {
    scene.__name__: partial(write, scene)
    for scene in (
        *(vggt, mapanything, da3, dust3r, cut3r, cut3r_trajectory, da3_streaming, vggt_slam),
        *(cloud_trajectory, vggt_colmap, mapanything_colmap, da3_colmap),
    )
}
