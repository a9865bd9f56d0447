"""What a run says of predictions that are mirrored, lost digits, or follow another convention."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.reconstruction.both_scenes import notes_of
from tests.reconstruction.world import (
    World,
    camera_poses,
    predict_clouds,
    save,
    true_points,
)


def test_a_mirrored_cloud_is_named_by_eval_and_check(world: World, tmp_path: Path) -> None:
    points, cameras = true_points("yard"), world.cameras("yard")
    origin = points.mean(axis=0) - np.array((0.0, 0.0, 30.0))
    extrinsics = cameras["extrinsics"].copy()
    extrinsics[..., 3] += (extrinsics[..., :3] @ origin[:, None])[..., 0]
    mirrored = (points - origin) * np.array((1, 1, -1))
    path = predict_clouds(world, tmp_path / "p", {"yard": mirrored})
    save(path / "yard.cameras.npz", cameras | {"extrinsics": extrinsics})
    notes = notes_of(world, path)
    assert any("mirrored or turned over" in note and "z negated" in note for note in notes)


@pytest.mark.parametrize("kind", ["ply", "npz", "points"])
def test_digits_that_were_lost_are_named(kind: str, world: World, tmp_path: Path) -> None:
    points, folder = true_points("yard") + 0.123, tmp_path / "p"
    folder.mkdir()
    if kind == "ply":
        rows = "\n".join(" ".join(f"{x:.6g}" for x in row) for row in points[:2000])
        head = "ply\nformat ascii 1.0\nelement vertex 2000\n"
        axes = "".join(f"property double {axis}\n" for axis in "xyz")
        (folder / "yard.ply").write_text(f"{head}{axes}end_header\n{rows}\n")
    elif kind == "npz":
        save(folder / "yard.npz", {"points": points.astype("f4")})
    else:
        maps = points[: 6 * 40 * 50].reshape(6, 40, 50, 3).astype("f4")
        save(folder / "yard.npz", world.cameras("yard") | {"points": maps})
    notes = notes_of(world, folder)
    told = "6 digits only, steps of 10 m" if kind == "ply" else "float32 only, steps of 0.5 m"
    assert any(told in note for note in notes), notes


@pytest.mark.parametrize("lost", ["float32", "6 digits", "nothing", "origin"])
def test_digits_that_cameras_lost_are_named(lost: str, world: World, tmp_path: Path) -> None:
    path = predict_clouds(world, tmp_path / "p", {"yard": true_points("yard")})
    cameras = world.cameras("yard")
    extrinsics = cameras["extrinsics"].copy()
    if lost == "float32":
        extrinsics = extrinsics.astype("f4")
    elif lost == "6 digits":
        extrinsics[..., :3] = np.round(extrinsics[..., :3], 6)
    elif lost == "origin":
        extrinsics[..., 3] += extrinsics[..., :3] @ true_points("yard").mean(axis=0)
        extrinsics = extrinsics.astype("f4")
    save(path / "yard.cameras.npz", cameras | {"extrinsics": extrinsics})
    named = [note for note in notes_of(world, path) if "extrinsics lost digits" in note]
    assert len(named) == (lost in ("float32", "6 digits")), named
    if named:
        stated = float(named[0].partition("an error of ")[2].partition(" m is")[0])
        centres = -np.einsum(
            "nij,ni->nj", *(extrinsics[..., part].astype("f8") for part in (np.s_[:3], 3))
        )
        moved = centres - camera_poses("yard").centres
        assert stated / 4 < np.sqrt((moved**2).sum(axis=1).mean()) < stated * 4


@pytest.mark.parametrize(("units", "depth", "asked"), [(1e4, 1.0, False), (1.0, 1e3, True)])
def test_far_depths_are_those_after_the_alignment(
    units: float, depth: float, asked: bool, world: World, tmp_path: Path
) -> None:
    fields = world.views("yard")
    fields["extrinsics"] = fields["extrinsics"] * np.array((1.0, 1.0, 1.0, units))
    fields["depth"] = fields["depth"] * units * depth
    path = save(tmp_path / "p" / "yard.npz", fields).parent
    assert any("are they in millimetres?" in note for note in notes_of(world, path)) == asked


def test_half_a_pixel_is_asked_for_where_it_matters(world: World, tmp_path: Path) -> None:
    exact, folder = world.views("lot"), tmp_path / "p"
    unsaid = {name: values for name, values in exact.items() if name != "pixel_centres"}
    # Depth 35 m at a focal length of 80 px: half a pixel in x and y is 0.3 m.
    notes = notes_of(world, save(folder / "lot.npz", unsaid).parent)
    (note,) = [note for note in notes if "does not say where K" in note]
    assert "taken as half" in note
    error = float(note.partition("points are ")[2].partition(" m off")[0])
    median = np.median(unsaid["depth"][unsaid["depth"] > 0])
    assert error == pytest.approx(np.hypot(0.5, 0.5) / 80 * median, rel=0.05)
    assert not any(
        "does not say" in n for n in notes_of(world, save(folder / "lot.npz", exact).parent)
    )
    coarse = world.protocol(
        tmp_path / "c.toml", scores={"f1_below_m": (10.0,), "headline_below_m": 10.0}
    )
    save(folder / "lot.npz", unsaid)
    assert not any("does not say" in note for note in notes_of(world, folder, str(coarse)))


def test_integer_pixel_centres_give_the_points_of_half_ones(world: World, tmp_path: Path) -> None:
    half = world.views("lot")
    integer = half | {"pixel_centres": np.array("integer"), "intrinsics": half["intrinsics"].copy()}
    integer["intrinsics"][:, :2, 2] -= 0.5
    wrong = integer | {"pixel_centres": np.array("half")}
    records = [
        world.score(save(tmp_path / name / "lot.npz", fields).parent)
        .scored["lot"]
        .records.to_dict("records")[0]
        for name, fields in (("half", half), ("integer", integer), ("wrong", wrong))
    ]
    assert records[0] == records[1]
    assert records[2] != records[0]


def test_files_without_names_are_read_as_depth_anything_3_writes_them(
    world: World, tmp_path: Path
) -> None:
    named = world.views("lot") | {"pixel_centres": np.array("integer")}
    bare = {key: named[key] for key in ("depth", "intrinsics", "extrinsics")}
    records = [
        world.score(save(tmp_path / name / "lot.npz", fields).parent)
        .scored["lot"]
        .records.to_dict("records")[0]
        for name, fields in (("named", named), ("bare", bare))
    ]
    assert records[0] == records[1]


@pytest.mark.parametrize("value", [1e300, -1e308, 1e160])
def test_cameras_beyond_all_measure_are_missing(value: float, world: World, tmp_path: Path) -> None:
    fields = world.views("yard")
    fields["extrinsics"] = fields["extrinsics"].copy()
    fields["extrinsics"][1, :, 3] = value
    path = save(tmp_path / "p" / "yard.npz", fields).parent
    record = world.score(path).scored["yard"].records.to_dict("records")[0]
    assert record["cameras_missing"] == 1
    assert record["f1_1m"] > 0.5
