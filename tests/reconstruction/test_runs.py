"""From predictions of scenes to files: result, records, alignments, pictures, coloured clouds."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.check import check
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.reconstruction.image_poses import ImagePoses, match_cameras
from airzoo_bench.reconstruction.truth import read_truth
from airzoo_bench.results.result import read_result
from tests.reconstruction.world import (
    MEMORY,
    PROTOCOL,
    World,
    camera_poses,
    make_world,
    predict_clouds,
    save,
    true_points,
)
from tests.support import files_below, run_main

PNG = b"\x89PNG\r\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world") / "data")


@pytest.fixture
def world(made: World, monkeypatch: pytest.MonkeyPatch) -> World:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(made.root))
    return made


def both(world: World, folder: Path, shift: float = 0.0) -> Path:
    clouds = {name: true_points(name) + np.array((0, 0, shift)) for name in ("yard", "lot")}
    return predict_clouds(world, folder / "p", clouds, cameras=False)


def test_the_files_of_a_run(world: World, tmp_path: Path) -> None:
    path, out = both(world, tmp_path), tmp_path / "out"
    assert run_main("eval", "reconstruction", path, "--out", out, "--figures", "--clouds") == 0
    names = [f"{scene}_{part}" for scene in ("yard", "lot") for part in ("precision", "recall")]
    curves = [f"{scene}_curve" for scene in ("yard", "lot")]
    assert files_below(out) == {
        *("result.json", "records.csv", "alignment.json", "figures", "clouds"),
        *(f"figures/{name}.png" for name in [*names, *curves]),
        *(f"clouds/{name}.ply" for name in names),
    }
    for picture in (out / "figures").iterdir():
        assert picture.read_bytes().startswith(PNG)
    read_result(out / "result.json")


def test_the_same_files_again(world: World, tmp_path: Path) -> None:
    path = both(world, tmp_path, 2.0)
    options = ("--figures", "--clouds", "--method", "same")
    for name, jobs in (("one", 1), ("two", 2)):
        out = tmp_path / name
        assert run_main("eval", "reconstruction", path, "--out", out, "-j", jobs, *options) == 0
    for file in files_below(tmp_path / "one"):
        if (tmp_path / "one" / file).is_file():
            one, two = ((tmp_path / name / file).read_bytes() for name in ("one", "two"))
            assert one == two, file


def test_colours_of_the_written_clouds(world: World, tmp_path: Path) -> None:
    points = true_points("lot")[:3] + np.array([[0, 0, 0], [0, 0, 9.999], [0, 0, 10.0]])
    path, out = (
        predict_clouds(world, tmp_path / "p", {"lot": points}, cameras=False),
        tmp_path / "o",
    )
    chosen = world.protocol(tmp_path / "c.toml", alignment={"method": "none"})
    arguments = ("--protocol", chosen, "--out", out, "--clouds")
    assert run_main("eval", "reconstruction", path, *arguments) == 0
    found = open_cloud(out / "clouds" / "lot_precision.ply", limit_bytes=MEMORY, sampling=None)
    (cloud,) = found.pieces(10)
    np.testing.assert_array_equal(cloud.points, points)  # float64: not a millimetre is lost
    assert cloud.colours is not None
    # The nearest true point is straight below, at 0, 9.999 and 10 metres.
    np.testing.assert_array_equal(cloud.colours, [[68, 1, 84], [253, 231, 37], [213, 94, 0]])
    recall = open_cloud(out / "clouds" / "lot_recall.ply", limit_bytes=MEMORY, sampling=None)
    np.testing.assert_array_equal(next(recall.pieces(20_000)).points, true_points("lot"))


@pytest.mark.parametrize("packed", [False, True])
def test_pictures_of_archives_too(packed: bool, world: World, tmp_path: Path) -> None:
    folder, path = both(world, tmp_path), tmp_path / "p.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for file in sorted(folder.iterdir()):
            archive.write(file, file.name)
    given = path if packed else folder
    out = tmp_path / "out"
    assert run_main("eval", "reconstruction", given, "--out", out, "--figures", "--clouds") == 0
    assert len(list((out / "figures").iterdir())) == 6
    assert len(list((out / "clouds").iterdir())) == 4


def test_alignment_json_brings_a_cloud_to_its_place(world: World, tmp_path: Path) -> None:
    fields = world.views("yard")
    centre = np.array((500_010.0, 5_200_010.0, 50.0))
    local = fields["extrinsics"].copy()
    local[..., 3] += (fields["extrinsics"][..., :3] @ centre[:, None])[..., 0]
    local[..., 3] *= 0.25
    fields |= {"extrinsics": local, "depth": fields["depth"] * 0.25}
    path, out = save(tmp_path / "p" / "yard.npz", fields).parent, tmp_path / "out"
    arguments = ("--protocol", PROTOCOL, "--out", out)
    assert run_main("eval", "reconstruction", path, *arguments) == 0
    (name, found), *others = json.loads((out / "alignment.json").read_text()).items()
    assert name == "yard"
    assert others == []  # a scene that the prediction lacks has no alignment
    assert set(found) == {
        *("method", "scale", "matrix", "cameras", "cameras_missing", "inliers", "inlier_limit_m"),
        *("used_orientations", "robust", "centres", "inlier_centres", "rotations_deg", "icp"),
        *("icp_failure", "inlier_names"),
    }
    assert found["scale"] == pytest.approx(4.0)
    assert found["robust"] is True
    assert (found["cameras"], found["inliers"], found["cameras_missing"]) == (6, 6, 0)
    for residuals in ("centres", "inlier_centres"):
        assert set(found[residuals]) == {"rms", "median", "largest"}
        assert found[residuals]["largest"] < 1e-6
    np.testing.assert_allclose(np.array(found["matrix"])[:3, 3], centre, atol=1e-6)


def test_alignment_json_with_icp(world: World, tmp_path: Path) -> None:
    path = predict_clouds(world, tmp_path / "p", {"yard": true_points("yard")})
    chosen = world.protocol(tmp_path / "c.toml", alignment={"method": "sim3+icp"})
    arguments = ("--protocol", chosen, "--out", tmp_path / "out")
    assert run_main("eval", "reconstruction", path, *arguments) == 0
    icp = json.loads((tmp_path / "out" / "alignment.json").read_text())["yard"]["icp"]
    assert set(icp) == {"before", "after", "iterations", "points"}
    assert set(icp["after"]) == {"fitness", "rmse", "cost"}
    assert icp["after"]["fitness"] == 1.0


def test_a_cloud_that_icp_cannot_refine_is_scored(world: World, tmp_path: Path) -> None:
    path = predict_clouds(world, tmp_path / "p", {"yard": true_points("yard") + 500.0})
    chosen = world.protocol(tmp_path / "c.toml", alignment={"method": "sim3+icp"})
    arguments = ("--protocol", chosen, "--out", tmp_path / "out")
    assert run_main("eval", "reconstruction", path, *arguments) == 0
    found = json.loads((tmp_path / "out" / "alignment.json").read_text())["yard"]
    assert found["icp"] is None
    assert "0 of 15264 predicted points within 2" in found["icp_failure"]
    notes = json.loads((tmp_path / "out" / "result.json").read_text())["notes"]
    assert any("aligned by cameras only" in note for note in notes)


def notes_of(world: World, path: Path, protocol: str = PROTOCOL) -> list[str]:
    """Return the notes of an evaluation, which are those of a check."""
    notes = list(world.score(path, protocol=protocol).result.notes)
    checked = check(path, data=world.root, protocol=protocol)
    assert not checked.errors
    assert list(checked.notes) == notes
    return notes


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
        world.score(save(tmp_path / name / "lot.npz", fields).parent).scored["lot"].record
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
        world.score(save(tmp_path / name / "lot.npz", fields).parent).scored["lot"].record
        for name, fields in (("named", named), ("bare", bare))
    ]
    assert records[0] == records[1]


def test_cameras_may_be_required(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = both(world, tmp_path)
    required = world.protocol(tmp_path / "c.toml", alignment={"cameras": "required"})
    assert run_main("eval", "reconstruction", path, "--protocol", required) == 2
    assert "holds no cameras, and the protocol requires them" in capsys.readouterr().err
    assert any("holds no cameras: taken as it stands" in note for note in notes_of(world, path))


@pytest.mark.parametrize("value", [1e300, -1e308, 1e160])
def test_cameras_beyond_all_measure_are_missing(value: float, world: World, tmp_path: Path) -> None:
    fields = world.views("yard")
    fields["extrinsics"] = fields["extrinsics"].copy()
    fields["extrinsics"][1, :, 3] = value
    path = save(tmp_path / "p" / "yard.npz", fields).parent
    record = world.score(path).scored["yard"].record
    assert record["cameras_missing"] == 1
    assert record["f1_1m"] > 0.5
    fields["extrinsics"][:, :, 3] = value
    save(path / "yard.npz", fields)
    assert run_main("eval", "reconstruction", path, "--protocol", PROTOCOL) == 2


def records_of(world: World, path: Path, tmp_path: Path, *options: object) -> pd.DataFrame:
    assert run_main("eval", "reconstruction", path, "--out", tmp_path / "out", *options) == 0
    return pd.read_csv(tmp_path / "out" / "records.csv").set_index("scene")


def test_records_and_counts(world: World, tmp_path: Path) -> None:
    clouds = {"yard": np.concatenate([true_points("yard"), [[np.nan, 0, 0]]])}
    path = predict_clouds(world, tmp_path / "p", clouds)
    chosen = world.protocol(
        tmp_path / "c.toml", preparation={"voxel_m": 1.0}, scores={"f1_below_m": (2.0,)}
    )
    records = records_of(world, path, tmp_path, "--protocol", chosen)
    text = (tmp_path / "out" / "records.csv").read_text()
    assert records["answered"].tolist() == [True, False]
    counts = json.loads((tmp_path / "out" / "result.json").read_text())["counts"]
    yard = counts["yard"]
    assert yard["points"] + yard["thinned"] == 15_264
    assert yard["truth_points"] + yard["truth_thinned"] == 15_264
    assert (yard["queries"], yard["missing"], yard["not_finite"]) == (1, 0, 1)
    assert (yard["cameras"], yard["cameras_missing"], yard["inlier_cameras"]) == (6, 0, 6)
    for name in set(yard) - {"queries", "missing"}:
        assert records.loc["yard", name] == yard[name]
    # Counts are whole numbers, and a missing scene has none but its points.
    assert f",{yard['points']}," in text
    assert records.loc["lot", "points"] == 0
    assert np.isnan(records.loc["lot", "truth_points"])
    assert counts["lot"] == {"queries": 1, "missing": 1, "points": 0}


def test_notes_of_readers_reach_the_result(world: World, tmp_path: Path) -> None:
    (tmp_path / "p").mkdir()
    (tmp_path / "p" / "yard.obj").write_text("v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n")
    fields = world.views("lot")
    fields["intrinsics"] = fields["intrinsics"].copy()
    fields["intrinsics"][1, 0, 2] += 14.0
    save(tmp_path / "p" / "lot.npz", fields)
    scored = world.score(tmp_path / "p")
    notes = scored.result.notes
    assert any(note.startswith("scene yard: a mesh of 1 face") for note in notes)
    assert any("scene lot: the principal point is far from the centre" in note for note in notes)
    assert scored.result.predictions.kind == "depth, mesh"


def test_a_file_alone_names_its_protocol(world: World, tmp_path: Path) -> None:
    fields = world.views("lot") | {"protocol": np.array(PROTOCOL)}
    path = save(tmp_path / "lot.npz", fields)
    assert run_main("check", path) == 0
    assert run_main("eval", "reconstruction", path) == 0


def test_a_file_alone_without_a_protocol(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = save(tmp_path / "lot.npz", world.views("lot"))
    for command in (("check",), ("eval", "reconstruction")):
        assert run_main(*command, path) == 2
        assert "or a field 'protocol' in a file alone" in capsys.readouterr().err
    assert run_main("check", path, "--protocol", PROTOCOL) == 0


def test_views_without_names_follow_the_names_of_the_files(world: World) -> None:
    """Names with their endings sort otherwise than the ids of photos, which have none."""
    truth = read_truth(Benchmark.open(world.folder), "yard")
    names = ["a.jpg", "a-1.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg"]
    truth = replace(truth, photos=truth.photos.assign(image=names))
    order = np.array([1, 0, 2, 3, 4, 5])
    numbered = np.array([f"view {n}" for n in range(6)])
    images = ImagePoses(
        numbered, np.ones(6, np.bool_), truth.poses.take(order), np.zeros(6), named=False
    )
    cameras = match_cameras(images, truth, "x")
    assert cameras is not None
    assert cameras.names == tuple(sorted(names)) == tuple(names[row] for row in order)


def test_views_without_names_or_poses_are_refused(world: World, tmp_path: Path) -> None:
    fields = world.views("lot")
    bare = {key: fields[key] for key in ("depth", "intrinsics")}
    lost = bare | {"extrinsics": np.full_like(fields["extrinsics"], np.nan)}
    path = save(tmp_path / "p" / "lot.npz", lost).parent
    with pytest.raises(PredictionError, match="too few poses to tell which view is which"):
        world.score(path)


def test_clouds_are_kept_only_where_they_are_asked_for(world: World, tmp_path: Path) -> None:
    path = both(world, tmp_path)
    assert world.score(path).scored["yard"].clouds is None
    kept = world.score(path, keep=True).scored["yard"]
    assert kept.clouds is not None
    assert kept.clouds[0].source.count == 15_264
    assert kept.distances is not None


def test_check_reports_all_scenes(world: World, tmp_path: Path) -> None:
    path = both(world, tmp_path)
    (path / "yard.ply").write_bytes(b"ply\n")
    (path / "lot.ply").write_bytes(b"ply\n")
    found: Any = check(path, data=world.root)
    assert len(found.errors) == 2


def test_checking_leaves_unknown_scenes_aside_as_eval_does(world: World, tmp_path: Path) -> None:
    path = both(world, tmp_path)
    (path / "plaza.ply").write_bytes(b"ply\n")
    assert run_main("check", path) == 0
    assert run_main("eval", "reconstruction", path) == 0
