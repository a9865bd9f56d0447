"""What odd reconstructions get, through ``eval`` and ``check``: a stated note."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.spoilt_clouds import (
    Make,
    cameras,
    clouds,
    edited,
    inverted,
    nan_at,
    other,
    taken,
    with_file,
    yard,
)
from tests.reconstruction.world import (
    World,
    matrix_of_maps,
    true_points,
)
from tests.support import run_main

Capture = pytest.CaptureFixture[str]


def notes_of(world: World, path: Path, tmp_path: Path, *options: object) -> str:
    assert run_main("eval", "reconstruction", path, "--out", tmp_path / "out", *options) == 0
    return "\n".join(json.loads((tmp_path / "out" / "result.json").read_text())["notes"])


def lon_lat(points: Any) -> Any:
    from pyproj import Transformer

    lon, lat = Transformer.from_crs(32633, 4326, always_xy=True).transform(*points[:, :2].T)
    return np.stack([lon, lat, points[:, 2]], axis=1)


def splats(path: Path) -> None:
    names = ["f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
    names += ["rot_0", "rot_1", "rot_2", "rot_3"]
    points = true_points("yard")
    rows = np.zeros(len(points), [(axis, "<f8") for axis in "xyz"] + [(n, "<f4") for n in names])
    for axis, column in zip("xyz", points.T, strict=True):
        rows[axis] = column
    kinds = [f"property double {axis}" for axis in "xyz"] + [f"property float {n}" for n in names]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *kinds]
    path.write_bytes("\n".join([*lines, "end_header\n"]).encode() + rows.tobytes())


NOTES: dict[str, tuple[Make, list[str]]] = {
    "nothing odd": (clouds(), []),
    "NaN points": (
        clouds(yard=nan_at(slice(0, 7))),
        ["scene yard: left out: 7 points with coordinates that are NaN, infinite or too"],
    ),
    "infinite points": (
        clouds(yard=lambda p: np.concatenate([p, [[np.inf, 0.0, -np.inf]]])),
        ["scene yard: left out: 1 point with coordinates that are NaN, infinite or too large"],
    ),
    "points too far to compute with": (
        clouds(yard=lambda p: np.concatenate([p, [[1e200, 0.0, -1e200]]])),
        ["scene yard: left out: 1 point with coordinates that are NaN, infinite or too large"],
    ),
    "OpenGL axes": (
        cameras(extrinsics=lambda w: np.diag((1.0, -1, -1)) @ w.cameras("yard")["extrinsics"]),
        ["scene yard: cameras are turned by 180 degrees (median)", "OpenGL axes", "reverse order"],
    ),
    "an empty cloud": (
        clouds(yard=np.zeros((0, 3))),
        ["scene yard: no point is left to compare: it scores 0 and infinite distances"],
    ),
    "millimetres": (
        clouds(cameras=False, yard=lambda p: p * 1000.0),
        ["scene yard: the cloud looks like millimetres", "scene yard: holds no cameras: taken as"],
    ),
    "longitude and latitude": (
        clouds(cameras=False, yard=lon_lat),
        ["scene yard: the cloud looks like longitude and latitude in degrees"],
    ),
    "a local origin": (
        clouds(cameras=False, yard=lambda p: p - p.min(axis=0)),
        ["scene yard: the cloud lies 5.22", "another coordinate system, or a local origin"],
    ),
    "x and y exchanged": (
        clouds(cameras=False, yard=lambda p: p[:, [1, 0, 2]]),
        ["scene yard: the cloud has x and y exchanged"],
    ),
    "single precision": (
        with_file("yard.npy", lambda p: np.save(p, true_points("yard").astype(np.float32))),
        ["scene yard: coordinates such as 5200060 are kept to float32 only, steps of 0.5 m"],
    ),
    "Gaussians": (with_file("yard.ply", splats), ["scene yard: ", "aussian"]),
    "camera-to-world, of few cameras": (
        cameras(
            extrinsics=lambda w: np.where(np.arange(6)[:, None, None] < 4, inverted(w), np.nan)
        ),
        ["scene yard: the extrinsics look inverted (camera-to-world for world-to-camera"],
    ),
    "a scene that the protocol lacks": (
        edited(clouds(), lambda p: shutil.copy(p / "lot.ply", p / "plaza.ply")),
        ["scenes that the protocol lacks, left aside: 1 (plaza)"],
    ),
    "a mistyped scene": (
        edited(clouds(), lambda p: (p / "yard.ply").rename(p / "yrad.ply")),
        ["left aside: 1 (yrad (did you mean 'yard'?))", "scored at their worst: 1 (yard)"],
    ),
    "files of no scene": (
        edited(clouds(), lambda p: (p / "readme.md").write_text("hi")),
        ["files that belong to no scene, left aside: 1 (readme.md)"],
    ),
    "a scene missing": (
        edited(clouds(), lambda p: (p / "lot.ply").unlink()),
        ["scenes that the predictions lack, scored at their worst: 1 (lot)"],
    ),
    "no cameras": (
        clouds(cameras=False),
        ["scene lot: holds no cameras: taken as it stands, without alignment by sim3"],
    ),
    "fewer photos than there are": (
        yard(extrinsics=taken(4)),
        ["scene yard: 2 of 6 photos have no pose", "scene yard: 2 of 6 depth maps have no pose"],
    ),
    "maps of other photos": (
        yard(
            depth=lambda w: w.views("yard")["depth"][:, :, 12:36],
            intrinsics=other(matrix_of_maps() - [[0, 0, 12.0], [0, 0, 0], [0, 0, 0]]),
        ),
        ["scene yard: maps of 24 x 36 for photos of 480 x 360: the images look cut, padded"],
    ),
    "no names, in order": (
        yard(image_names=None),
        ["scene yard: has no image_names: its views were taken for the photos in the order of"],
    ),
}


@pytest.mark.parametrize("case", list(NOTES))
def test_notes_of_eval_and_of_check(
    case: str, world: World, tmp_path: Path, capsys: Capture
) -> None:
    make, fragments = NOTES[case]
    path = make(world, tmp_path / "p")
    notes = notes_of(world, path, tmp_path)
    for fragment in fragments:
        assert fragment in notes
    if not fragments:
        assert notes == ""
    capsys.readouterr()
    assert run_main("check", path) == 0
    told = capsys.readouterr().err
    for note in notes.splitlines():
        # The count of missing scenes is of results only: check names them anyway.
        assert note in told or "are missing from the predictions" in note or "ids of" in note


def test_a_crop_that_leaves_nothing_says_so(world: World, tmp_path: Path) -> None:
    path = clouds(cameras=False, yard=lambda p: p * 1000.0)(world, tmp_path / "p")
    chosen = world.protocol(tmp_path / "c.toml", preparation={"crop": "box", "crop_margin_m": 5.0})
    notes = notes_of(world, path, tmp_path, "--protocol", chosen)
    assert "scene yard: no point is left to compare" in notes
    assert "scene yard: 100%" in notes
    assert "scene yard: the cloud looks like millimetres" in notes
