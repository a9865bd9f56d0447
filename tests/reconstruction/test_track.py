"""The whole track on a made world: scores by hand, views, files of a run, and failures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.reconstruction.cameras import ImagePoses, match_cameras
from airzoo_bench.reconstruction.similarity import umeyama
from airzoo_bench.reconstruction.truth import read_truth
from airzoo_bench.results.result import read_result
from tests.reconstruction.world import (
    ORIGIN,
    PROTOCOL,
    SIDE,
    STEP,
    Array,
    World,
    both,
    camera_poses,
    notes_of,
    predict_clouds,
    save,
    true_points,
)
from tests.support import files_below, run_main


def lot(world: World, folder: Path, points: Array, **sections: Any) -> dict[str, Any]:
    """Return the record of the lot for predicted points, taken as they stand."""
    path = predict_clouds(world, folder / "p", {"lot": points}, cameras=False)
    chosen = world.protocol(folder / "c.toml", alignment={"method": "none"}, **sections)
    return world.record("lot", path, protocol=str(chosen))


def test_a_plane_shifted_by_three_metres(world: World, tmp_path: Path) -> None:
    scores = {"f1_below_m": (1.0, 3.0, 3.001)}
    record = lot(world, tmp_path, true_points("lot") + np.array((0, 0, 3.0)), scores=scores)
    for column in ("chamfer_m", "accuracy_m", "completeness_m", "accuracy_median_m"):
        assert record[column] == 3.0
    # Strictly below: at three metres nothing is right yet.
    assert [record[f"f1_{d}m"] for d in ("1", "3", "3.001", "10")] == [0.0, 0.0, 1.0, 1.0]


def test_half_of_a_plane(world: World, tmp_path: Path) -> None:
    points = true_points("lot")
    kept = points[points[:, 0] < ORIGIN[0] + SIDE / 2]
    record = lot(world, tmp_path, kept)
    columns = int(SIDE / STEP)  # of points; those without a partner are 1 to 60 steps away
    away = STEP * np.arange(1, columns // 2 + 1)
    assert record["accuracy_m"] == 0.0
    assert record["precision_10m"] == 1.0
    assert record["completeness_m"] == pytest.approx(away.sum() / columns, rel=1e-12)
    recall = (columns // 2 + int((away < 10).sum())) / columns
    assert record["recall_10m"] == recall == 79 / 120
    assert record["f1_10m"] == pytest.approx(2 * recall / (1 + recall), rel=1e-15)
    assert record["chamfer_m"] == pytest.approx(away.sum() / columns / 2, rel=1e-12)


def test_an_empty_prediction_and_a_missing_scene(world: World, tmp_path: Path) -> None:
    path = predict_clouds(world, tmp_path / "p", {"lot": np.zeros((0, 3))})
    evaluation = world.score(path)
    for scene in ("lot", "yard"):
        values = evaluation.result.scenes[scene]
        assert values["f1_10m"] == values["precision_10m"] == values["recall_10m"] == 0.0
        assert np.isinf([values["chamfer_m"], values["accuracy_m"], values["completeness_m"]]).all()
    assert evaluation.records["answered"].tolist() == [False, True]
    assert evaluation.result.counts["yard"] == {"queries": 1, "missing": 1, "points": 0}
    assert evaluation.result.counts["lot"]["points"] == 0
    assert evaluation.result.counts["lot"]["truth_points"] == 14_400


def moved(points: Array, scale: float, seed: int = 5) -> tuple[Array, Array, Array]:
    """Return points in another frame, its rotation and its origin."""
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    return (points - ORIGIN) @ turn.T * scale, turn, ORIGIN


def moved_cameras(world: World, scene: str, scale: float, seed: int = 5) -> dict[str, Any]:
    poses = camera_poses(scene)
    centres, turn, _ = moved(poses.centres, scale, seed)
    rotation = poses.rotation @ turn.T
    extrinsics = np.concatenate([rotation, -(rotation @ centres[..., None])], axis=2)
    return world.cameras(scene, extrinsics=extrinsics)


def test_sim3_brings_back_a_cloud_of_any_frame(world: World, tmp_path: Path) -> None:
    points, turn, _ = moved(true_points("lot"), 0.02)
    path = predict_clouds(world, tmp_path / "p", {"lot": points})
    save(path / "lot.cameras.npz", moved_cameras(world, "lot", 0.02))
    scored = world.score(path).scored["lot"]
    assert scored.records.iloc[0]["scale"] == pytest.approx(50.0, rel=1e-9)
    assert scored.records.iloc[0]["chamfer_m"] < 1e-6
    assert scored.records.iloc[0]["f1_0.2m"] == 1.0
    matrix = np.array(scored.facts["alignment"]["matrix"])
    np.testing.assert_allclose(matrix[:3, :3], 50.0 * turn.T, atol=1e-7)
    homogeneous = np.append(points[7], 1.0)
    back = matrix @ homogeneous
    np.testing.assert_allclose(back[:3], true_points("lot")[7], atol=1e-5)


@pytest.mark.parametrize("method", ["back-projection", "tsdf"])
def test_maps_without_a_pose_are_nowhere(method: str, world: World, tmp_path: Path) -> None:
    fields = world.views("yard")
    rows = np.array([0, 2, 3, 5])
    few = {name: values[rows] if values.ndim else values for name, values in fields.items()}
    extrinsics = fields["extrinsics"].copy()
    extrinsics[[1, 4]] = np.nan
    lost = fields | {"extrinsics": extrinsics}
    chosen = world.protocol(tmp_path / "c.toml", fusion={"method": method})
    records = [
        world.record("yard", save(tmp_path / name / "yard.npz", one).parent, protocol=str(chosen))
        for name, one in (("few", few), ("lost", lost))
    ]
    assert records[0] == records[1]
    assert records[1]["not_finite"] == 0
    assert records[1]["cameras_missing"] == 2


@pytest.mark.parametrize("dtype", ["float32", "uint8"])
@pytest.mark.parametrize("kind", ["depth", "points", "cloud"])
def test_pixels_and_points_must_exceed_the_confidence(
    kind: str, dtype: str, world: World, tmp_path: Path
) -> None:
    fields = world.views("lot")
    shape = fields["depth"].shape
    some = (0, 2, 3, 255) if dtype == "uint8" else (0.1, 2.0, 2.00001, 9.0)
    conf = np.resize(some, shape).astype(dtype)
    if kind == "depth":
        save(tmp_path / "p" / "lot.npz", fields | {"conf": conf})
    elif kind == "points":
        points = np.resize(true_points("lot"), (*shape, 3))
        save(tmp_path / "p" / "lot.npz", world.cameras("lot") | {"points": points, "conf": conf})
    else:
        points = np.resize(true_points("lot"), (conf.size, 3))
        save(tmp_path / "p" / "lot.npz", {"points": points, "confidence": conf.ravel()})
        save(tmp_path / "p" / "lot.cameras.npz", world.cameras("lot"))
    chosen = world.protocol(tmp_path / "c.toml", fusion={"confidence_above": 2.0})
    evaluation = world.score(tmp_path / "p", protocol=str(chosen))
    record = evaluation.scored["lot"].records.iloc[0].to_dict()
    assert (record["points"], record["distrusted"]) == (conf.size // 2, conf.size // 2)
    assert any("left out: 3,456 points of too little" in n for n in evaluation.result.notes)


@pytest.mark.parametrize(("method", "fusion"), [("sim3+icp", "back-projection"), ("sim3", "tsdf")])
def test_scores_do_not_depend_on_the_frame_of_the_prediction(
    method: str, fusion: str, world: World, tmp_path: Path
) -> None:
    fields = world.views("yard")
    random = np.random.default_rng(3)
    fields["depth"] = fields["depth"] * (1 + random.normal(0, 0.003, fields["depth"].shape))
    used = {"method": method, "icp_points": 5000, "icp_iterations": 10}
    chosen = world.protocol(tmp_path / "c.toml", alignment=used, fusion={"method": fusion})
    records = []
    for number, scale in enumerate((1.0, 0.003)):
        other = fields | moved_cameras(world, "yard", scale, seed=number)
        other["depth"] = fields["depth"] * scale
        path = save(tmp_path / f"{number}" / "yard.npz", other).parent
        records.append(world.record("yard", path, protocol=str(chosen)))
    one, other = records
    assert one["points"] == other["points"]
    for name in ("f1_0.2m", "f1_0.5m", "f1_1m", "pose_auc_3deg"):
        assert one[name] == pytest.approx(other[name], abs=1e-3), name
    for name in ("chamfer_m", "accuracy_m", "completeness_m", "ate_m"):
        assert one[name] == pytest.approx(other[name], rel=1e-4, abs=1e-6), name


PNG = b"\x89PNG\r\n"


def test_the_files_of_a_run(world: World, tmp_path: Path) -> None:
    path = predict_clouds(world, tmp_path / "p", {"lot": true_points("lot")}, cameras=False)
    out, names = tmp_path / "out", ("lot_precision", "lot_recall")
    assert run_main("eval", "reconstruction", path, "--out", out, "--figures", "--clouds") == 0
    assert files_below(out) == {
        *("result.json", "records.csv", "alignment.json", "figures", "clouds"),
        *("figures/clouds.npz", "figures/lot_cloud.png"),
        *(f"clouds/{name}.ply" for name in names),
    }
    assert (out / "figures" / "lot_cloud.png").read_bytes().startswith(PNG)
    read_result(out / "result.json")


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


Capture = pytest.CaptureFixture[str]


def test_the_template_names_all_photos_and_scores(
    world: World, tmp_path: Path, capsys: Capture
) -> None:
    out = tmp_path / "preds"
    assert run_main("template", PROTOCOL, "--out", out) == 0
    assert f"airzoo-bench eval reconstruction {out}" in capsys.readouterr().err
    assert files_below(out) == {"protocol.txt", "yard.npz", "lot.npz"}
    with np.load(out / "yard.npz") as arrays:
        assert arrays["image_names"].tolist() == world.images("yard")
        assert arrays["depth"].shape == (6, 24, 32)  # the photos' proportions
        rotation = arrays["extrinsics"][:, :, :3]
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)
    assert run_main("check", out) == 0
    scored = world.record("yard", out)
    assert scored["points"] == 6 * 24 * 32
    assert scored["pose_auc_3deg"] < 0.2


def test_ate_sees_the_cameras_that_the_alignment_left_out(world: World, tmp_path: Path) -> None:
    poses = camera_poses("yard")
    centres = poses.centres.copy()
    centres[0] += (0.0, 30.0, 0.0)
    extrinsics = np.concatenate([poses.rotation, -(poses.rotation @ centres[..., None])], axis=2)
    path = predict_clouds(world, tmp_path / "p", {"yard": true_points("yard")})
    save(path / "yard.cameras.npz", world.cameras("yard", extrinsics=extrinsics))
    record = world.record("yard", path)
    assert record["inlier_cameras"] == 5
    assert record["chamfer_m"] < 1e-6
    fit = umeyama(centres, poses.centres, with_scale=True)
    left = np.linalg.norm(fit.apply(centres) - poses.centres, axis=1)
    assert record["ate_m"] == pytest.approx(np.sqrt((left**2).mean()), rel=1e-9)


def test_cameras_may_be_required(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = both(world, tmp_path)
    required = world.protocol(tmp_path / "c.toml", alignment={"cameras": "required"})
    assert run_main("eval", "reconstruction", path, "--protocol", required) == 2
    message = capsys.readouterr().err
    assert "cameras" in message
    assert "requires" in message
    assert any("no cameras" in note for note in notes_of(world, path))


@pytest.fixture(scope="module")
def lot_scores(made: World, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the scores of the lot when it is predicted right."""
    path = predict_clouds(made, tmp_path_factory.mktemp("lot"), {"lot": true_points("lot")})
    return made.score(path).result.scenes["lot"]


@pytest.mark.parametrize("fault", ["2 cameras", "no camera", "one point", "no names", "NaN"])
def test_a_failed_scene_scores_its_worst_and_is_named(
    fault: str, world: World, tmp_path: Path, lot_scores: dict[str, Any]
) -> None:
    path = predict_clouds(world, tmp_path / "p", {s: true_points(s) for s in ("yard", "lot")})
    fields = world.views("yard") if fault == "no names" else world.cameras("yard")
    poses = fields["extrinsics"].copy()
    if fault == "NaN":
        write_ply(path / "yard.ply", Cloud(np.full((9, 3), np.nan)))
    elif fault == "one point":
        poses[..., 3] = 0.0
    else:
        poses[2 if fault == "2 cameras" else 0 :] = np.nan
    if fault == "no names":
        (path / "yard.ply").unlink()
        (path / "yard.cameras.npz").unlink()
        del fields["image_names"]
    name = "yard.npz" if fault == "no names" else "yard.cameras.npz"
    save(path / name, fields | {"extrinsics": poses})
    result = world.score(path).result
    assert result.scenes["lot"] == lot_scores
    failed = result.scenes["yard"]
    assert [failed[f"{what}_10m"] for what in ("precision", "recall", "f1")] == [0.0, 0.0, 0.0]
    assert np.isinf([failed["chamfer_m"], failed["accuracy_m"], failed["completeness_m"]]).all()
    assert failed["cameras_placed"] == (fault == "NaN")
    assert result.counts["yard"].get("failed", 0) == (fault != "NaN")
    assert any(note.startswith("scene yard: ") for note in result.notes)
    if fault == "2 cameras":
        assert notes_of(world, path) == list(result.notes)


@pytest.mark.parametrize("method", ["back-projection", "tsdf"])
def test_fusion_gives_the_same_bytes_again(method: str, world: World, tmp_path: Path) -> None:
    path = save(tmp_path / "p" / "yard.npz", world.views("yard")).parent
    chosen = world.protocol(tmp_path / "c.toml", fusion={"method": method})
    records = [
        world.score(path, protocol=str(chosen), jobs=jobs, memory_bytes=memory).records
        for jobs, memory in ((1, 1 << 30), (2, 2 << 20))
    ]
    assert records[0].to_csv() == records[1].to_csv()
