"""Predictions of the reconstruction track that are wrong, and what the command says of them."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from tests.reconstruction.world import (
    PROTOCOL,
    World,
    camera_poses,
    matrix_of_maps,
    predict_clouds,
    save,
    true_points,
)

Make = Callable[[World, Path], Path]


RIGHT = ("yard", "lot")


def clouds(cameras: bool = True, **scenes: Any) -> Make:
    """Predict the true clouds but for some, given as points or as what changes them."""

    def make(world: World, folder: Path) -> Path:
        points = {scene: true_points(scene) for scene in RIGHT}
        for scene, given in scenes.items():
            points[scene] = given(points[scene]) if callable(given) else given
        return predict_clouds(world, folder, points, cameras)

    return make


def yard(**changes: Any) -> Make:
    """Predict exact depth maps, those of the yard with some fields changed."""

    def make(world: World, folder: Path) -> Path:
        found = {k: v(world) if callable(v) else v for k, v in changes.items()}
        save(folder / "yard.npz", world.views("yard", **found))
        save(folder / "lot.npz", world.views("lot"))
        (folder / "protocol.txt").write_text(PROTOCOL)
        return folder

    return make


def cameras(**changes: Any) -> Make:
    """Predict the true clouds with other cameras of the yard."""

    def make(world: World, folder: Path) -> Path:
        clouds()(world, folder)
        found = {k: v(world) if callable(v) else v for k, v in changes.items()}
        save(folder / "yard.cameras.npz", world.cameras("yard", **found))
        return folder

    return make


def with_file(name: str, write: Callable[[Path], object]) -> Make:
    """Predict the true clouds, with a file instead of the yard's cloud."""

    def make(world: World, folder: Path) -> Path:
        clouds()(world, folder)
        (folder / "yard.ply").unlink()
        (folder / name).parent.mkdir(exist_ok=True)
        write(folder / name)
        return folder

    return make


def write_laz(path: Path, points: Any) -> None:
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = points.min(axis=0), np.full(3, 0.001)
    file = laspy.LasData(header)
    file.x, file.y, file.z = points.T
    file.write(path)


def cut_laz(path: Path) -> None:
    random = np.random.default_rng(0)
    write_laz(path, random.uniform(0, 50, (120_000, 3)) + true_points("yard").mean(axis=0))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def lying_ply(promised: int) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        write_ply(path, Cloud(true_points("yard")))
        content = path.read_bytes()
        count = f"element vertex {len(true_points('yard'))}\n".encode()
        assert count in content
        path.write_bytes(content.replace(count, f"element vertex {promised}\n".encode()))

    return write


def taken(count: int) -> Callable[[World], Any]:
    """Return the extrinsics of the yard with so many poses, NaN in the others."""

    def poses(world: World) -> Any:
        found = world.cameras("yard")["extrinsics"].copy()
        found[count:] = np.nan
        return found

    return poses


def inverted(world: World) -> Any:
    poses = camera_poses("yard")
    local = poses.centres - poses.centres.mean(axis=0)
    return np.concatenate([poses.rotation.swapaxes(1, 2), local[..., None]], axis=2)


def at_one_point(world: World) -> Any:
    found = world.cameras("yard")["extrinsics"].copy()
    found[..., 3] = 0.0
    return found


def backwards(world: World) -> Any:
    """Return true orientations with centres on a line that runs against the flight."""
    poses = camera_poses("yard")
    local = poses.centres - poses.centres.mean(axis=0)
    along = np.linalg.svd(local)[2][0]
    centres = -(local @ along)[:, None] * along
    return np.concatenate([poses.rotation, -(poses.rotation @ centres[..., None])], axis=2)


def nan_at(rows: Any) -> Callable[[Any], Any]:
    def change(points: Any) -> Any:
        changed = points.copy()
        changed[rows, 1] = np.nan
        return changed

    return change


def other(matrix: Any) -> Any:
    return lambda world: np.tile(matrix, (6, 1, 1))


def edited(make: Make, edit: Callable[[Path], object]) -> Make:
    def made_and_edited(world: World, folder: Path) -> Path:
        path = make(world, folder)
        edit(path)
        return path

    return made_and_edited


FAULTS: dict[str, tuple[Make, list[str]]] = {
    "nothing there": (lambda _, folder: folder, ["p: no such predictions", "a folder, or an arch"]),
    "an empty folder": (
        lambda _, folder: (folder.mkdir(), folder)[1],
        ["p: holds no cloud, mesh or npz", "school.ply", "name the files by their scenes"],
    ),
    "a document": (
        lambda _, folder: (folder.with_suffix(".doc").write_text("a"), folder.with_suffix(".doc"))[
            1
        ],
        ["p.doc: no kind of file that", "'.doc'", ".ply", "template"],
    ),
    "only other scenes": (
        edited(clouds(), lambda p: [f.rename(p / f"x{f.name}") for f in p.glob("*.ply")]),
        ["p: holds none of the scenes of made-reconstruction: 2 (xlot, xyard)", "yard, lot"],
    ),
    "no protocol": (
        edited(clouds(), lambda p: (p / "protocol.txt").unlink()),
        ["p: does not say which protocol it is for", "protocol.txt", "--protocol"],
    ),
    "another track's protocol": (
        edited(clouds(), lambda p: (p / "protocol.txt").write_text("airzoo-mini-retrieval")),
        ["p: protocol airzoo-mini-retrieval is of the retrieval track"],
    ),
    "a path as protocol": (
        edited(clouds(), lambda p: (p / "protocol.txt").write_text("../x.toml")),
        ["protocol.txt: the protocol '../x.toml' is no protocol's name"],
    ),
    "all NaN": (
        clouds(yard=nan_at(slice(None))),
        ["p, scene yard: all 15,264 points have a coordinate that is NaN", "write the cloud again"],
    ),
    "a LAZ cut in the middle": (
        with_file("yard.laz", cut_laz),
        ["yard.laz: ", "copy the file again"],
    ),
    "a PLY that promises more points": (
        with_file("yard.ply", lying_ply(20_000)),
        ["yard.ply: ", "20,000", "copy the file again"],
    ),
    "a PLY that promises more than memory": (
        with_file("yard.ply", lying_ply(10**15)),
        ["yard.ply: ", "1,000,000,000,000,000"],
    ),
    "no cloud at all": (
        with_file("yard.ply", lambda p: p.write_bytes(b"")),
        ["yard.ply: is empty"],
    ),
    "an image": (
        with_file("yard.ply", lambda p: p.write_bytes(b"\x89PNG\r\n\x1a\n")),
        ["yard.ply: is no cloud that can be read: it looks like a PNG image"],
    ),
    "two entries of a scene": (
        edited(clouds(), lambda p: shutil.copy(p / "yard.ply", p / "yard.pcd")),
        ["p: scene 'yard' has two entries: yard.pcd and yard.ply", "keep one"],
    ),
    "depth and confidence of different sizes": (
        yard(conf=np.ones((6, 18, 24))),
        ["yard.npz", "'conf' has shape (6, 18, 24)", "(6, 36, 48)"],
    ),
    "depth of one view too few": (
        yard(depth=np.ones((5, 36, 48))),
        ["yard.npz", "6 rows for 5 images", "a row an image"],
    ),
    "integer depth": (
        yard(depth=np.ones((6, 36, 48), np.uint16)),
        ["yard.npz", "field 'depth' is uint16", "floating point", "often millimetres, / 1000"],
    ),
    "intrinsics of the photos": (
        yard(intrinsics=other(matrix_of_maps() * [[10.0], [10.0], [1.0]])),
        ["field 'intrinsics': the principal point is 10 times the centre", "480 x 360", "48 x 36"],
    ),
    "normalised intrinsics": (
        yard(intrinsics=other(np.array([[1.7, 0, 0.5], [0, 1.7, 0.5], [0, 0, 1]]))),
        ["field 'intrinsics'", "normalised to 0..1"],
    ),
    "no intrinsics": (
        yard(intrinsics=None),
        ["yard.npz: lacks the field intrinsics", "(N, 3, 3)"],
    ),
    "transposed extrinsics": (
        yard(extrinsics=lambda w: np.swapaxes(square(w), 1, 2)),
        ["field 'extrinsics': a last row other than 0 0 0 1", "transposed"],
    ),
    "rotations that are none": (
        yard(extrinsics=lambda w: w.cameras("yard")["extrinsics"] * 2.0),
        ["field 'extrinsics'"],
    ),
    "depth and points": (
        yard(world_points=np.ones((6, 36, 48, 3))),
        ["yard.npz", "holds depth and world_points, and they could disagree"],
    ),
    "a misspelt field": (
        yard(confidences=np.ones((6, 36, 48))),
        ["yard.npz: has fields that are not read here: 'confidences'"],
    ),
    "a name that the truth lacks": (
        yard(image_names=lambda w: np.array([*w.images("yard")[:5], "IMG_7.JPG"])),
        ["scene yard, field 'image_names'", "lacks: 1 of 6 ('IMG_7.JPG')", "such as 'yard_0.jpg'"],
    ),
    "a mistyped name": (
        yard(image_names=lambda w: np.array([*w.images("yard")[:5], "yrad_5.jpg"])),
        ["lacks: 1 of 6 ('yrad_5.jpg' (did you mean 'yard_5.jpg'?))"],
    ),
    "names of another scene": (
        cameras(image_names=lambda w: np.array([f"lot_{n}.jpg" for n in range(6)])),
        ["scene yard, field 'image_names'", "6 of 6 (first 3: 'lot_0.jpg'"],
    ),
    "a name twice": (
        cameras(image_names=lambda w: np.array([*w.images("yard")[:5], "yard_0.jpg"])),
        ["yard.cameras.npz, field 'image_names'", "more than once: 1 of 6 ('yard_0.jpg')"],
    ),
    "a name with its ending and without": (
        cameras(image_names=lambda w: np.array([*w.images("yard")[:5], "yard_0"])),
        ["scene yard, field 'image_names'", "with their ending and without: 1 of 6 ('yard_0.jpg')"],
    ),
    "no names, another number of views": (
        yard(
            **{
                key: lambda w, key=key: w.views("yard")[key][:5]
                for key in ("depth", "intrinsics", "extrinsics")
            },
            image_names=None,
        ),
        ["scene yard: has no image_names, and 5 views for 6 photos", "np.savez("],
    ),
    "no names, another order": (
        yard(
            **{
                key: lambda w, key=key: w.views("yard")[key][::-1]
                for key in ("depth", "intrinsics", "extrinsics")
            },
            image_names=None,
        ),
        ["scene yard: has no image_names, and its cameras do not fit", "image_names=names"],
    ),
    "no names and camera-to-world": (
        yard(extrinsics=inverted, image_names=None),
        ["p, scene yard: has no image_names, and its cameras do not fit", "look camera-to-world"],
    ),
    "two cameras": (
        yard(extrinsics=taken(2)),
        ["scene yard: a similarity needs 3 cameras, and 2 of 6", "align by 'none'"],
    ),
    "no pose at all": (
        yard(extrinsics=taken(0)),
        ["scene yard: a similarity needs 3 cameras, and 0 of 6"],
    ),
    "all cameras at one point": (
        cameras(extrinsics=at_one_point),
        ["scene yard: the predicted camera centres all lie at one point, which has no scale"],
    ),
    "cameras on a line that fly backwards": (
        cameras(extrinsics=backwards),
        ["scene yard: the cameras' orientations contradict their centres", "world-to-camera"],
    ),
    "extrinsics twice": (
        edited(yard(), lambda p: shutil.copy(p / "yard.npz", p / "yard.cameras.npz")),
        ["yard.cameras.npz"],
    ),
}


def square(world: World) -> Any:
    rows = np.tile([[[0.0, 0.0, 0.0, 1.0]]], (6, 1, 1))
    return np.concatenate([world.cameras("yard")["extrinsics"], rows], axis=1)
