"""From predictions of scenes to files: result, records, alignments, pictures, coloured clouds."""

from __future__ import annotations

import json
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import pytest
import trimesh

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.check import check
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.reconstruction.camera_names import match_cameras
from airzoo_bench.reconstruction.image_poses import ImagePoses
from airzoo_bench.reconstruction.truth import read_truth
from airzoo_bench.results.result import read_result
from tests.reconstruction.both_scenes import both, notes_of
from tests.reconstruction.world import (
    MEMORY,
    PROTOCOL,
    World,
    predict_clouds,
    save,
    true_points,
)
from tests.support import files_below, run_main

PNG = b"\x89PNG\r\n"


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


@pytest.mark.parametrize(
    ("part", "beside"),
    [
        pytest.param("draw_error_map", (), marks=pytest.mark.slow),
        ("write_ply", ("thesis.tex",)),
    ],
)
def test_interrupted_between_two_pictures_the_old_run_is_there_whole(
    part: str, beside: tuple[str, ...], world: World, tmp_path: Path
) -> None:
    path, out = both(world, tmp_path), tmp_path / "out"
    ask = ("eval", "reconstruction", path, "--out", out, "--figures", "--clouds", "--method")
    assert run_main(*ask, "old") == 0
    for name in beside:
        (out / name).touch()
    before = {name: (out / name).stat().st_mtime_ns for name in files_below(out)}
    draw = mock.Mock(side_effect=[None, KeyboardInterrupt])
    with mock.patch(f"airzoo_bench.report.reconstruction.{part}", draw):
        assert run_main(*ask, "new") == 130
    assert draw.call_count == 2
    assert {name: (out / name).stat().st_mtime_ns for name in files_below(out)} == before
    assert read_result(out / "result.json").predictions.method == "old"


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
    # The nearest true point is straight below, at 0, 9.999 and 10 metres.
    colours = trimesh.load(out / "clouds" / "lot_precision.ply").colors[:, :3]
    np.testing.assert_array_equal(colours, [[68, 1, 84], [253, 231, 37], [213, 94, 0]])
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


def test_cameras_may_be_required(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = both(world, tmp_path)
    required = world.protocol(tmp_path / "c.toml", alignment={"cameras": "required"})
    assert run_main("eval", "reconstruction", path, "--protocol", required) == 2
    assert "holds no cameras, and the protocol requires them" in capsys.readouterr().err
    assert any("holds no cameras: taken as it stands" in note for note in notes_of(world, path))


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


@pytest.mark.parametrize(("named", "words"), [(True, "leaves out"), (False, "6 views for 4")])
def test_photos_that_are_left_out_are_said_to_be_so(world: World, named: bool, words: str) -> None:
    """A method that was given all photos of a scene had more than the others."""
    truth = read_truth(Benchmark.open(world.folder), "yard")
    names = truth.photos["image"].to_numpy(dtype=str)
    images = ImagePoses(names, np.ones(6, np.bool_), truth.poses, np.zeros(6), named=named)
    left_out = truth.photos[4:][["id", "image"]].assign(reason="not among the photos")
    less = replace(truth, photos=truth.photos[:4], excluded=left_out)
    with pytest.raises(PredictionError, match=words) as refused:
        match_cameras(images, less, "x")
    assert "the photos of scenes/SCENE/reconstruction/photos.csv" in str(refused.value.fix)
    other = replace(images, names=np.array([*names[:5], "other.jpg"]))
    if named:
        with pytest.raises(PredictionError, match="names that the benchmark lacks"):
            match_cameras(other, less, "x")


def test_clouds_are_kept_only_where_they_are_asked_for(world: World, tmp_path: Path) -> None:
    path = both(world, tmp_path)
    assert world.score(path).scored["yard"].details is None
    kept = world.score(path, keep=True).scored["yard"].details
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
