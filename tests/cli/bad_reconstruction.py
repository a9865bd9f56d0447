"""Predictions of the reconstruction track that are wrong, and what the command says of them."""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np
import pytest

from tests.cli.spoilt_clouds import (
    Make,
    backwards,
    cameras,
    clouds,
    cut_laz,
    edited,
    inverted,
    lying_ply,
    other,
    with_file,
    yard,
)
from tests.reconstruction.world import (
    World,
    matrix_of_maps,
)

FAULTS: dict[str, tuple[Make, list[str]]] = {
    "nothing there": (lambda _, folder: folder, ["p: no such predictions", "a folder, an arch"]),
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
    "camera-to-world": (
        yard(extrinsics=inverted),
        [
            "scene yard: the extrinsics look inverted (camera-to-world for world-to-camera",
            "degrees off the truth as they stand, 0.0 once inverted",
            "fix:      invert them: R.T and -R.T @ t",
        ],
    ),
    "no names and camera-to-world": (
        yard(extrinsics=inverted, image_names=None),
        [
            "p, scene yard: has no image_names, and its cameras do not fit",
            "look inverted",
            "fix:      invert the extrinsics",
        ],
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


Capture = pytest.CaptureFixture[str]
