"""The whole track on a made world: scores by hand, views, poses, failures; nothing buys a score."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import SceneInputs
from airzoo_bench.core.files import sha256_of
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.rasters import RasterInfo
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.reconstruction import track
from airzoo_bench.reconstruction.alignment import umeyama
from airzoo_bench.reconstruction.clouds import bounding_box, cloud_of, observed_cells
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.track import CloudComparison, compare, score_comparison
from airzoo_bench.reconstruction.truth import build_truth, open_true_cloud, read_truth
from airzoo_bench.results.records import read_methods
from tests.formats.cloud_support import LIMIT, SAMPLING
from tests.reconstruction.world import (
    ORIGIN,
    PROTOCOL,
    SIDE,
    STEP,
    Array,
    World,
    camera_poses,
    extrinsics_of,
    made_truth,
    make_world,
    predict_clouds,
    protocol,
    save,
    surface,
    true_points,
    write_laz,
)
from tests.support import files_below, run_main


def scored(world: World, path: Path, scene: str = "yard", **sections: Any) -> dict[str, Any]:
    """Return a scene's record by a protocol with some keys changed."""
    chosen = world.protocol(path.parent / "c.toml", **sections)
    return world.record(scene, path, protocol=str(chosen))


def lot(world: World, folder: Path, points: Array, **sections: Any) -> dict[str, Any]:
    """Return the record of the lot for predicted points, taken as they are."""
    path = predict_clouds(world, folder / "p", {"lot": points}, cameras=False)
    return scored(world, path, "lot", alignment={"method": "none"}, **sections)


def test_a_plane_shifted_by_three_metres(world: World, tmp_path: Path) -> None:
    scores = {"f1_below_m": (1.0, 3.0, 3.001)}
    record = lot(world, tmp_path, true_points("lot") + np.array((0, 0, 3.0)), scores=scores)
    for column in ("chamfer_m", "accuracy_m", "completeness_m", "accuracy_median_m"):
        assert record[column] == 3.0
    # Strictly below: at three metres nothing is right yet.
    assert [record[f"f1_{d}m"] for d in ("1", "3", "3.001", "10")] == [0.0, 0.0, 1.0, 1.0]


def test_half_of_a_plane(world: World, tmp_path: Path) -> None:
    points = true_points("lot")
    record = lot(world, tmp_path, points[points[:, 0] < ORIGIN[0] + SIDE / 2])
    columns = int(SIDE / STEP)  # of points; those without a partner are 1 to 60 steps away
    away = STEP * np.arange(1, columns // 2 + 1)
    assert (record["accuracy_m"], record["precision_10m"]) == (0.0, 1.0)
    assert record["completeness_m"] == pytest.approx(away.sum() / columns, rel=1e-12)
    assert record["chamfer_m"] == pytest.approx(away.sum() / columns / 2, rel=1e-12)
    recall = (columns // 2 + int((away < 10).sum())) / columns
    assert record["recall_10m"] == recall == 79 / 120
    assert record["f1_10m"] == pytest.approx(2 * recall / (1 + recall), rel=1e-15)


def elsewhere(world: World, scene: str, scale: float, seed: int) -> tuple[Array, dict[str, Any]]:
    """Return the turn into another frame of another scale, and the cameras there."""
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    poses = camera_poses(scene)
    rotation, centres = poses.rotation @ turn.T, (poses.centres - ORIGIN) @ turn.T * scale
    return turn, world.cameras(scene) | {"extrinsics": extrinsics_of(rotation, centres)}


def test_sim3_brings_back_a_cloud_of_any_frame(world: World, tmp_path: Path) -> None:
    turn, cameras = elsewhere(world, "lot", 0.02, 5)
    points = (true_points("lot") - ORIGIN) @ turn.T * 0.02
    path, out = predict_clouds(world, tmp_path / "p", {"lot": points}), tmp_path / "out"
    save(path / "lot.cameras.npz", cameras)
    assert run_main("eval", "reconstruction", path, "--data", world.root, "--out", out) == 0
    assert files_below(out) == {"result.json", "records.csv", "alignment.json"}
    [method] = read_methods([out])
    assert method.result.scenes["lot"]["f1_0.2m"] == 1.0
    assert "4 of 4 cameras, scale 50," in track.describe_alignments(method)[0]
    # A scene that the prediction lacks has no alignment.
    ((name, found),) = json.loads((out / "alignment.json").read_text()).items()
    assert name == "lot"
    assert found["scale"] == pytest.approx(50.0, rel=1e-9)
    assert (found["cameras"], found["inliers"], found["cameras_missing"]) == (4, 4, 0)
    back = np.array(found["matrix"]) @ np.append(points[7], 1.0)
    np.testing.assert_allclose(back[:3], true_points("lot")[7], atol=1e-5)


@pytest.mark.parametrize("method", ["back-projection", "tsdf"])
def test_maps_without_a_pose_are_nowhere_and_bytes_are_the_same(method, world, tmp_path) -> None:
    fields, rows = world.views("yard"), np.array([0, 2, 3, 5])
    few = {name: values[rows] if values.ndim else values for name, values in fields.items()}
    lost = fields | {"extrinsics": fields["extrinsics"].copy()}
    lost["extrinsics"][[1, 4]] = np.nan
    chosen = world.protocol(tmp_path / "c.toml", fusion={"method": method, "tsdf_voxel_m": 1.0})
    own = {"protocol": str(chosen)}
    one = world.record("yard", save(tmp_path / "few/yard.npz", few).parent, **own)
    path = save(tmp_path / "lost/yard.npz", lost).parent
    other = world.record("yard", path, run=Run(2 << 20, jobs=2), **own)
    assert one == other
    assert (other["not_finite"], other["cameras_missing"]) == (0, 2)


BYTES = np.array((0, 2, 3, 255), np.uint8)
CONFIDENCES = {"depth": np.array((0.1, 2.0, 2.00001, 9.0), "f4"), "points": BYTES, "cloud": BYTES}


@pytest.mark.parametrize("kind", CONFIDENCES)
def test_pixels_and_points_must_exceed_the_confidence(kind, world, tmp_path) -> None:
    fields, cameras = world.views("lot"), world.cameras("lot")
    conf = np.resize(CONFIDENCES[kind], fields["depth"].shape)
    points = np.resize(true_points("lot"), (*conf.shape, 3))
    given = {
        "depth": fields | {"conf": conf},
        "points": cameras | {"points": points, "conf": conf},
        "cloud": {"points": points.reshape(-1, 3), "confidence": conf.ravel()},
    }
    path = save(tmp_path / "p" / "lot.npz", given[kind]).parent
    if kind == "cloud":
        save(path / "lot.cameras.npz", cameras)
    record = scored(world, path, "lot", fusion={"confidence_above": 2.0})
    assert (record["points"], record["distrusted"]) == (conf.size // 2, conf.size // 2)


@pytest.mark.parametrize(("method", "fusion"), [("sim3+icp", "back-projection"), ("sim3", "tsdf")])
def test_scores_do_not_depend_on_the_frame_of_the_prediction(
    method: str, fusion: str, world: World, tmp_path: Path
) -> None:
    fields, random = world.views("yard"), np.random.default_rng(3)
    fields["depth"] = fields["depth"] * (1 + random.normal(0, 0.003, fields["depth"].shape))
    used = {"method": method, "icp_points": 5000, "icp_iterations": 10}
    records = []
    for number, scale in enumerate((1.0, 0.003)):
        there = fields | elsewhere(world, "yard", scale, number)[1]
        there["depth"] = fields["depth"] * scale
        path = save(tmp_path / f"{number}" / "yard.npz", there).parent
        records.append(scored(world, path, alignment=used, fusion={"method": fusion}))
    one, other = records
    assert one["points"] == other["points"]
    for name in ("f1_0.2m", "f1_0.5m", "f1_1m", "pose_auc_3deg"):
        assert one[name] == pytest.approx(other[name], abs=1e-3), name
    for name in ("chamfer_m", "accuracy_m", "completeness_m", "ate_m"):
        assert one[name] == pytest.approx(other[name], rel=1e-4, abs=1e-6), name


def test_the_template_names_all_photos_and_scores(world: World, tmp_path: Path) -> None:
    out = tmp_path / "preds"
    assert run_main("template", PROTOCOL, "--data", world.root, "--out", out) == 0
    assert files_below(out) == {"protocol.txt", "yard.npz", "lot.npz"}
    with np.load(out / "yard.npz") as arrays:
        assert arrays["image_names"].tolist() == world.images("yard")
        assert arrays["depth"].shape == (6, 24, 32)  # the photos' proportions
    assert world.record("yard", out)["points"] == 6 * 24 * 32


@pytest.mark.parametrize("fault", ["missing", "empty", "no camera", "no names"])
def test_a_failed_scene_scores_its_worst_and_is_named(fault, world, tmp_path) -> None:
    path = predict_clouds(world, tmp_path / "p", {s: true_points(s) for s in ("yard", "lot")})
    cloud, cameras, lost = path / "yard.ply", path / "yard.cameras.npz", world.cameras("yard")
    lost["extrinsics"][:] = np.nan
    if fault == "empty":
        write_ply(cloud, Cloud(np.zeros((0, 3))))
    elif fault == "no camera":
        save(cameras, lost)
    else:
        cloud.unlink()
        cameras.unlink()
    if fault == "no names":
        del lost["image_names"]
        save(path / "yard.npz", world.views("yard") | lost)
    result = world.score(path).result
    assert result.scenes["lot"]["f1_0.2m"] == 1.0
    values, counts = result.scenes["yard"], result.counts["yard"]
    assert [values[f"{what}_10m"] for what in ("precision", "recall", "f1")] == [0.0, 0.0, 0.0]
    assert np.isinf([values["chamfer_m"], values["accuracy_m"], values["completeness_m"]]).all()
    assert values["cameras_placed"] == (fault == "empty")
    assert counts["missing"] == (fault == "missing")
    assert counts.get("failed", 0) == (fault in ("no camera", "no names"))
    assert any("yard" in note for note in result.notes)


# --- camera poses ---


def posed(world: World, folder: Path, rotation: Array, centres: Array) -> dict[str, Any]:
    """Return the record of the yard with other poses, aligned by nothing."""
    path = predict_clouds(world, folder / "p", {"yard": true_points("yard")})
    extrinsics = extrinsics_of(rotation, centres)
    save(path / "yard.cameras.npz", world.cameras("yard") | {"extrinsics": extrinsics})
    scores = {"trajectory_alignment": "cloud"}
    return scored(world, path, alignment={"method": "none"}, scores=scores)


def test_one_camera_turned_by_ten_degrees(world: World, tmp_path: Path) -> None:
    poses = camera_poses("yard")
    turn = Rotation.from_rotvec(np.radians(10) * np.array([0.6, 0.8, 0.0])).as_matrix()
    rotation = poses.rotation.copy()
    rotation[3] = turn @ rotation[3]
    values = posed(world, tmp_path, rotation, poses.centres)
    # 10 of the 30 ordered pairs have it, and err by the whole turn.
    assert values["pose_auc_5deg"] == pytest.approx(20 / 30, abs=1e-6)
    assert values["pose_auc_15deg"] == pytest.approx(20 / 30 + 10 / 30 * 5 / 15, abs=1e-6)
    assert values["ate_m"] < 1e-8  # of coordinates of millions of metres
    assert values["rpe_deg"] == pytest.approx(np.sqrt(2 * 100 / 5), rel=1e-7)


def test_one_camera_moved(world: World, tmp_path: Path) -> None:
    poses = camera_poses("yard")
    centres = poses.centres.copy()
    centres[0] += (0.0, 0.0, 2.0)
    values = posed(world, tmp_path, poses.rotation, centres)
    assert values["ate_m"] == pytest.approx(np.sqrt(4 / 6), rel=1e-6)
    # The first camera has one step only.
    assert values["rpe_m"] == pytest.approx(np.sqrt(4 / 5), rel=1e-6)
    # Once aligned, ATE sees the camera that the alignment left out.
    centres[0] += (0.0, 30.0, 0.0)
    posed(world, tmp_path, poses.rotation, centres)
    record = world.record("yard", tmp_path / "p")
    assert (record["inlier_cameras"], record["chamfer_m"] < 1e-6) == (5, True)
    fit = umeyama(centres, poses.centres, with_scale=True)
    left = np.linalg.norm(fit.apply(centres) - poses.centres, axis=1)
    assert record["ate_m"] == pytest.approx(np.sqrt((left**2).mean()), rel=1e-9)


def test_cameras_that_are_left_out_buy_no_score(world: World, tmp_path: Path) -> None:
    """Three of six cameras fit anything: their share, and the AUC, say so."""
    path = predict_clouds(world, tmp_path / "p", {s: true_points(s) for s in ("yard", "lot")})
    few = {name: values[:3] for name, values in world.cameras("yard").items()}
    values = world.record("yard", save(path / "yard.cameras.npz", few).parent)
    assert values["cameras_placed"] == 0.5
    assert values["pose_auc_30deg"] == pytest.approx(6 / 30, abs=1e-6)
    (path / "yard.cameras.npz").unlink()
    values = world.score(path).result.scenes["yard"]
    assert np.isinf([values["ate_m"], values["rpe_m"], values["rpe_deg"]]).all()
    assert values["f1_10m"] == 1.0


# --- the truth ---


def test_the_fingerprint_covers_cloud_and_poses(tmp_path: Path) -> None:
    world = make_world(tmp_path / "data")
    truth = read_truth(Benchmark.open(world.folder), "yard")
    other = read_truth(Benchmark.open(world.folder), "lot").fingerprint
    cloud, file = world.folder / "data" / "yard" / "cloud.ply", world.folder / "benchmark.toml"
    before = sha256_of(cloud)
    write_ply(cloud, Cloud(true_points("yard")[:-1]))
    file.write_text(file.read_text().replace(before, sha256_of(cloud)))
    changed = read_truth(Benchmark.open(world.folder), "yard").fingerprint
    assert len({changed, truth.fingerprint, other}) == 3


def test_photos_that_are_not_chosen_and_those_without_a_pose_are_listed(tmp_path: Path) -> None:
    write_ply(tmp_path / "c.ply", Cloud(np.zeros((1, 3))))
    dom = RasterInfo.__new__(RasterInfo)  # reconstruction does not look at the map
    photos, dsm = made_truth("lot").photos, tmp_path / "dsm.tif"
    inputs = SceneInputs("lot", photos, "EPSG:32633", dom, dsm, 100.0, ("z.png",))
    truth = build_truth(inputs, tmp_path / "c.ply", pd.Series([True, True, False, True]))
    assert truth.photos["image"].tolist() == ["lot_0.jpg", "lot_1.jpg", "lot_3.jpg"]
    reasons = dict(zip(truth.excluded["image"], truth.excluded["reason"], strict=True))
    assert [*reasons] == ["lot_2.jpg", "z.png"]
    assert len({*reasons.values()}) == 2


# --- scores cannot be bought, and are the same to the bit ---


TRUTH = made_truth("yard")


def compared(
    points: Any, truth: Any, used: ReconstructionProtocol, *, block: int = 1 << 20, jobs: int = 1
) -> tuple[dict[str, Any], CloudComparison]:
    run = Run(memory_bytes=block * track._BYTES_A_POINT, jobs=jobs)
    cloud, true = (cloud_of(one) if isinstance(one, np.ndarray) else one for one in (points, truth))
    found = compare(cloud, TRUTH.posed, TRUTH, true, used, run)
    posed = track.pose_scores(TRUTH.posed, found.alignment.transform, TRUTH.posed, used.scores)
    scored = score_comparison("yard", found, posed, used.scores)
    record: dict[str, Any] = scored.records.iloc[0].to_dict()
    return record, found


def bought(points: Array, **sections: Any) -> dict[str, Any]:
    """Return the record of a cloud in the yard by the shipped preparation and scores."""
    shipped = load_protocol(shipped_protocols()["photos-reconstruction"]).model_dump()
    given = {name: shipped[name] | sections.get(name, {}) for name in ("preparation", "scores")}
    used = protocol(alignment={"method": "none"}, **given)
    return compared(points, true_points("yard"), used)[0]


def test_a_flood_with_one_true_point_many_times_over() -> None:
    along, up = np.arange(0.0, SIDE, 1.1), np.arange(-5.0, 25.0, 1.1)
    flood = np.stack(np.meshgrid(along, along, up), axis=-1).reshape(-1, 3) + ORIGIN
    cheat = np.concatenate([flood, np.repeat(true_points("yard")[:1], 400_000, axis=0)])
    plain = {"crop": "none", "region": "all", "voxel_m": "none"}
    unlimited = {"max_distance_m": "none"}
    assert bought(cheat, preparation=plain, scores=unlimited)["f1_1m"] > 0.9
    assert bought(cheat)["f1_1m"] < 0.2
    # An honest sparse cloud: every 40th true point, off by 0.2 m.
    sparse = true_points("yard")[::40]
    sparse = sparse + np.random.default_rng(0).normal(0, 0.2, sparse.shape)
    assert bought(sparse)["f1_1m"] > 0.3


def test_recall_is_over_the_points_that_the_photos_saw() -> None:
    points = true_points("yard")
    everywhere = bought(points)
    assert everywhere["f1_1m"] == 1.0
    assert 0 < everywhere["truth_unseen"] < everywhere["truth_points"]
    cloud, settings = cloud_of(points), protocol().preparation
    photos = TRUTH.cameras, TRUTH.poses
    seen = observed_cells(cloud, bounding_box(cloud), *photos, settings, 1 << 20)
    observed = points[seen.holds(points)]
    # Voxels lie across the borders of cells, so that a few are lost.
    recall = bought(observed)["recall_1m"]
    assert recall > 0.95
    assert bought(observed, preparation={"region": "all"})["recall_1m"] < recall - 0.02


VARIANTS: dict[str, dict[str, Any]] = {
    "sim3": {},
    "none": {"alignment": {"method": "none"}},
    "icp": {"alignment": {"method": "sim3+icp", "icp_points": 500_000, "icp_iterations": 5}},
    "covered": {"preparation": {"crop": "covered", "crop_margin_m": 2.0}},
    "observed": {"preparation": {"region": "observed"}},
    "voxels": {"preparation": {"voxel_m": 0.7}, "scores": {"f1_below_m": (10.0,)}},
}


@pytest.mark.parametrize("variant", list(VARIANTS))
def test_the_same_for_any_blocks_threads_and_order(variant, monkeypatch) -> None:
    monkeypatch.setattr(track, "_LEAST_BLOCK", 1)
    used, random = protocol(**VARIANTS[variant]), np.random.default_rng(0)
    truth = true_points("yard")
    points = truth + random.normal(0, 0.4, truth.shape)
    points[:50] += 300.0
    points[50:60] = np.nan
    one, found = compared(points, truth, used)
    other, again = compared(points, truth, used, block=3001, jobs=3)
    assert str(one) == str(other)
    np.testing.assert_array_equal(found.curve.f1, again.curve.f1)
    if variant != "icp":
        shuffled = random.permutation(points), random.permutation(truth)
        assert str(compared(*shuffled, used)[0]) == str(one)


def in_shards(folder: Path, points: Array, count: int) -> CloudSource:
    folder.mkdir(parents=True)
    for number, part in enumerate(np.array_split(points, count)):
        write_laz(folder / f"tile-{number:02}.laz", part)
    return open_true_cloud(folder, LIMIT, SAMPLING)


@pytest.mark.parametrize(
    "steps", [{"region": "observed", "observed_cell_m": 2.0}, {"crop": "covered", "voxel_m": 0.1}]
)
def test_shards_score_as_one_cloud_does(steps, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(track, "_LEAST_BLOCK", 300)
    first, second = (one + ORIGIN - 50.0 for one in (surface(2000, 0, far=0.05), surface(1500, 1)))
    first = np.vstack((first, first[::3] + 0.01, first[::7] + 0.003))  # shards share voxels
    used = protocol(alignment={"method": "none", "cameras": "optional"}, preparation=steps)
    both = [in_shards(tmp_path / "one", first, 6), in_shards(tmp_path / "two", second, 4)]
    write_laz(tmp_path / "one" / "tile-021.laz", np.zeros((0, 3)))
    joined = [np.concatenate([piece.points for piece in one.pieces(50)]) for one in both]
    whole, there = compared(*joined, used)
    assert (whole["thinned"] > 500) == ("voxel_m" in steps)
    record, found = compared(*both, used, block=0)
    assert str(record) == str(whole)
    for expected, measured in zip(there.distances, found.distances, strict=True):
        np.testing.assert_array_equal(measured, expected)
