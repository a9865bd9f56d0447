"""The whole track on a made world: scores by hand, oracles, and sameness to the last bit."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.alignment.consensus import PosedCameras
from airzoo_bench.reconstruction.alignment.similarity import umeyama
from airzoo_bench.reconstruction.observed import observed_cells
from airzoo_bench.reconstruction.placing import (
    BlockWork,
    MatchedPrediction,
    ScoringSettings,
    TrueScene,
    align_scene,
)
from airzoo_bench.reconstruction.prepared import InMemoryCloud
from airzoo_bench.reconstruction.regions import bounding_box
from airzoo_bench.reconstruction.scoring import ScoredScene, score_scene
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from tests.geometry.support import quick, seeds
from tests.reconstruction.cloud_support import all_pairs
from tests.reconstruction.world import (
    ORIGIN,
    SIDE,
    STEP,
    Array,
    World,
    camera_poses,
    ground,
    lenses,
    make_world,
    predict_clouds,
    protocol,
    save,
    true_points,
)

NEAR = 1e-8  # of coordinates of millions of metres, after an alignment


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world") / "data")


def lot(world: World, folder: Path, points: Array, **sections: Any) -> dict[str, Any]:
    """Return the record of the lot for predicted points, taken as they stand."""
    path = predict_clouds(world, folder / "p", {"lot": points}, cameras=False)
    chosen = world.protocol(folder / "c.toml", alignment={"method": "none"}, **sections)
    return world.score(path, protocol=str(chosen)).scored["lot"].record


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


def test_duplicates_weigh_unless_they_are_thinned(world: World, tmp_path: Path) -> None:
    points = true_points("lot")
    far = points[:1200] + np.array((0, 0, 50.0))
    twice = np.concatenate([points, far, far])
    record = lot(world, tmp_path, twice)
    assert record["precision_10m"] == 14_400 / 16_800
    assert record["recall_10m"] == 1.0
    thin = lot(world, tmp_path, twice, preparation={"voxel_m": 0.25}, scores={"f1_below_m": (1.0,)})
    assert thin["precision_10m"] == 14_400 / 15_600
    assert (thin["thinned"], thin["points"], thin["truth_thinned"]) == (1200, 15_600, 0)


def test_thinning_both_clouds_by_voxels(world: World, tmp_path: Path) -> None:
    # Four points of half a metre are one voxel of a metre; the prediction lies a metre above.
    points = true_points("lot") + np.array((0, 0, 1.0))
    record = lot(
        world, tmp_path, points, preparation={"voxel_m": 1.0}, scores={"f1_below_m": (2.0,)}
    )
    # Voxels begin at 0.38 m: at the borders they hold fewer.
    assert (record["points"], record["truth_points"]) == (61**2, 61**2)
    assert record["chamfer_m"] == pytest.approx(1.0, abs=NEAR)


def test_a_crop_leaves_out_what_lies_beyond_its_margin(world: World, tmp_path: Path) -> None:
    points = true_points("lot")
    at = points[:1] * (1, 1, 0) + np.array([[0, 0, 105.0], [0, 0, 105.001], [0, 0, 900.0]])
    record = lot(
        world,
        tmp_path,
        np.concatenate([points, at]),
        preparation={"crop": "box", "crop_margin_m": 5.0},
    )
    assert (record["points"], record["outside"]) == (14_401, 2)
    assert record["accuracy_m"] == pytest.approx(5.0 / 14_401, rel=1e-9)


def test_a_single_point(world: World, tmp_path: Path) -> None:
    record = lot(world, tmp_path, true_points("lot")[:1] + np.array((0, 0, 2.0)))
    assert record["accuracy_m"] == 2.0
    assert record["precision_10m"] == 1.0
    assert 0 < record["recall_10m"] < 0.2


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


def test_the_average_is_unweighted(world: World, tmp_path: Path) -> None:
    clouds = {"lot": true_points("lot") + np.array((0, 0, 20.0)), "yard": true_points("yard")}
    path = predict_clouds(world, tmp_path / "p", clouds, cameras=False)
    result = world.score(path).result
    assert result.overall["f1_10m"] == 0.5
    assert result.overall["chamfer_m"] == 10.0


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
    assert scored.record["scale"] == pytest.approx(50.0, rel=1e-9)
    assert scored.record["chamfer_m"] < 1e-6
    assert scored.record["f1_0.2m"] == 1.0
    assert scored.alignment is not None
    np.testing.assert_allclose(scored.alignment.transform.rotation, turn.T, atol=1e-9)
    homogeneous = np.append(points[7], 1.0)
    back = scored.alignment.transform.matrix @ homogeneous
    np.testing.assert_allclose(back[:3], true_points("lot")[7], atol=1e-5)


def test_depth_maps_of_any_scale(world: World, tmp_path: Path) -> None:
    fields = world.views("lot") | moved_cameras(world, "lot", 0.1)
    fields["depth"] = fields["depth"] * 0.1
    record = world.score(save(tmp_path / "p" / "lot.npz", fields).parent).scored["lot"].record
    # All pixels see the ground, within half a diagonal of the true cloud's grid.
    assert record["accuracy_m"] < STEP / 2
    assert record["precision_0.5m"] == 1.0
    assert record["scale"] == pytest.approx(10.0, rel=1e-9)


def test_point_maps_are_the_same_points(world: World, tmp_path: Path) -> None:
    depth = world.views("yard")
    poses, size = camera_poses("yard"), depth["depth"].shape
    v, u = np.mgrid[: size[1], : size[2]] + 0.5
    K = depth["intrinsics"][0]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], axis=-1)
    local = rays[None] * depth["depth"][..., None]
    points = np.einsum("nji,nhwj->nhwi", poses.rotation, local) + poses.centres[:, None, None]
    given = {"world_points": points, **world.cameras("yard")}
    records = [
        world.score(save(tmp_path / name / "yard.npz", fields).parent).scored["yard"].record
        for name, fields in (("depth", depth), ("points", given))
    ]
    assert records[0]["points"] == records[1]["points"] == 6 * 36 * 48
    for column in ("chamfer_m", "f1_0.2m", "f1_0.5m", "pose_auc_3deg"):
        assert records[0][column] == pytest.approx(records[1][column], abs=1e-3)


def test_fusing_keeps_the_surface_and_thins_it(world: World, tmp_path: Path) -> None:
    path = save(tmp_path / "p" / "yard.npz", world.views("yard")).parent
    chosen = world.protocol(tmp_path / "c.toml", fusion={"method": "tsdf"})
    record = world.score(path, protocol=str(chosen)).scored["yard"].record
    plain = world.score(path).scored["yard"].record
    assert record["precision_1m"] > 0.98
    assert record["recall_1m"] > 0.9 * plain["recall_1m"]
    assert 0 < record["points"] < plain["points"]


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
        world.score(save(tmp_path / name / "yard.npz", one).parent, protocol=str(chosen))
        .scored["yard"]
        .record
        for name, one in (("few", few), ("lost", lost))
    ]
    assert records[0] == records[1]
    assert records[1]["not_finite"] == 0
    assert records[1]["cameras_missing"] == 2


@pytest.mark.parametrize("kind", ["depth", "points", "cloud"])
def test_pixels_and_points_must_exceed_the_confidence(
    kind: str, world: World, tmp_path: Path
) -> None:
    fields = world.views("lot")
    shape = fields["depth"].shape
    conf = np.resize((0.1, 0.5, 0.50001, 0.9), shape).astype(np.float32)
    if kind == "depth":
        save(tmp_path / "p" / "lot.npz", fields | {"conf": conf})
    elif kind == "points":
        points = np.resize(true_points("lot"), (*shape, 3))
        save(tmp_path / "p" / "lot.npz", world.cameras("lot") | {"points": points, "conf": conf})
    else:
        points = np.resize(true_points("lot"), (conf.size, 3))
        write_ply(tmp_path / "p" / "lot.ply", Cloud(points, confidence=conf.ravel()))
        save(tmp_path / "p" / "lot.cameras.npz", world.cameras("lot"))
    chosen = world.protocol(tmp_path / "c.toml", fusion={"confidence_above": 0.5})
    evaluation = world.score(tmp_path / "p", protocol=str(chosen))
    record = evaluation.scored["lot"].record
    assert (record["points"], record["distrusted"]) == (conf.size // 2, conf.size // 2)
    assert any("left out: 3,456 points of too little" in n for n in evaluation.result.notes)


def test_icp_mends_poor_cameras(world: World, tmp_path: Path) -> None:
    cameras = world.cameras("yard")
    poses = camera_poses("yard")
    centres = poses.centres - np.array((0.0, 0.0, 0.7))
    cameras["extrinsics"][..., 3] = -(poses.rotation @ centres[..., None])[..., 0]
    path = predict_clouds(world, tmp_path / "p", {"yard": true_points("yard")})
    save(path / "yard.cameras.npz", cameras)
    rough = world.score(path).scored["yard"].record
    icp = {"method": "sim3+icp", "icp_with_scale": False, "icp_points": 4000, "icp_tolerance": 1e-9}
    chosen = world.protocol(tmp_path / "c.toml", alignment=icp)
    scored = world.score(path, protocol=str(chosen)).scored["yard"]
    assert rough["chamfer_m"] > 0.1
    assert scored.record["chamfer_m"] < 0.1 * rough["chamfer_m"]
    assert scored.alignment is not None
    assert scored.alignment.icp is not None


def test_icp_leaves_out_points_that_are_not_finite(world: World, tmp_path: Path) -> None:
    points = true_points("yard")
    points[::3] = np.nan
    path = predict_clouds(world, tmp_path / "p", {"yard": points})
    chosen = world.protocol(tmp_path / "c.toml", alignment={"method": "sim3+icp"})
    scored = world.score(path, protocol=str(chosen)).scored["yard"]
    assert scored.record["accuracy_m"] < 1e-6
    assert scored.record["not_finite"] == 5088
    assert scored.alignment is not None
    assert scored.alignment.icp is not None
    assert scored.alignment.icp.points == 15_264 - 5088
    assert scored.alignment.icp.after.fitness == 1.0


def test_a_mesh_is_sampled(world: World, tmp_path: Path) -> None:
    corners = np.array([[0, 0], [SIDE, 0], [SIDE, SIDE], [0, SIDE]])
    lines = [f"v {x + ORIGIN[0]} {y + ORIGIN[1]} {ORIGIN[2]}" for x, y in corners]
    (tmp_path / "p").mkdir()
    (tmp_path / "p" / "lot.obj").write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4\n"]))
    chosen = world.protocol(tmp_path / "c.toml", meshes={"points": 20_000})
    evaluation = world.score(tmp_path / "p", protocol=str(chosen))
    record = evaluation.scored["lot"].record
    assert evaluation.result.predictions.kind == "mesh"
    assert record["points"] == 20_000
    assert record["f1_1m"] > 0.999
    assert any("20,000 points sampled" in note for note in evaluation.result.notes)


def with_poses(world: World, folder: Path, extrinsics: Array | None) -> dict[str, float]:
    """Return the scores of the yard with other poses, aligned by nothing."""
    path = predict_clouds(world, folder / "p", {s: true_points(s) for s in ("yard", "lot")})
    if extrinsics is None:
        (path / "yard.cameras.npz").unlink()
    else:
        save(path / "yard.cameras.npz", world.cameras("yard", extrinsics=extrinsics))
    as_it_stands = {"trajectory_alignment": "cloud"}
    chosen = world.protocol(folder / "c.toml", alignment={"method": "none"}, scores=as_it_stands)
    return world.score(path, protocol=str(chosen)).result.scenes["yard"]


def test_perfect_poses(world: World, tmp_path: Path) -> None:
    values = with_poses(world, tmp_path, world.cameras("yard")["extrinsics"])
    assert values["pose_auc_3deg"] == pytest.approx(1.0, abs=1e-7)
    assert values["ate_m"] < NEAR
    assert values["rpe_m"] < NEAR
    assert values["rpe_deg"] < 1e-6  # a truth has quaternions to 1e-9


def test_one_camera_turned_by_ten_degrees(world: World, tmp_path: Path) -> None:
    poses = camera_poses("yard")
    turn = Rotation.from_rotvec(np.radians(10) * np.array([0.6, 0.8, 0.0])).as_matrix()
    rotation = poses.rotation.copy()
    rotation[3] = turn @ rotation[3]
    wrong = Poses(rotation=rotation, centres=poses.centres)
    extrinsics = np.concatenate([rotation, wrong.translation[..., None]], axis=2)
    values = with_poses(world, tmp_path, extrinsics)
    # 10 of the 30 ordered pairs have it, and err by the whole turn.
    assert values["pose_auc_5deg"] == pytest.approx(20 / 30, abs=1e-6)
    assert values["pose_auc_15deg"] == pytest.approx(20 / 30 + 10 / 30 * 5 / 15, abs=1e-6)
    assert values["ate_m"] < NEAR
    assert values["rpe_deg"] == pytest.approx(np.sqrt(2 * 100 / 5), rel=1e-7)


def test_one_camera_moved_by_two_metres(world: World, tmp_path: Path) -> None:
    poses = camera_poses("yard")
    centres = poses.centres.copy()
    centres[0] += (0.0, 0.0, 2.0)
    extrinsics = np.concatenate([poses.rotation, -(poses.rotation @ centres[..., None])], axis=2)
    values = with_poses(world, tmp_path, extrinsics)
    assert values["ate_m"] == pytest.approx(np.sqrt(4 / 6), rel=1e-6)
    # The first camera has one step only.
    assert values["rpe_m"] == pytest.approx(np.sqrt(4 / 5), rel=1e-6)


def test_a_camera_without_a_pose(world: World, tmp_path: Path) -> None:
    extrinsics = world.cameras("yard")["extrinsics"].copy()
    extrinsics[2] = np.nan
    values = with_poses(world, tmp_path, extrinsics)
    assert values["pose_auc_30deg"] == pytest.approx(20 / 30, abs=1e-6)
    assert values["cameras_placed"] == 5 / 6
    assert values["ate_m"] < NEAR


def test_cameras_that_are_left_out_buy_no_score(world: World, tmp_path: Path) -> None:
    """Three of six cameras fit anything: their share, and the AUC, say so."""
    few = world.cameras("yard")
    few = {name: values[:3] for name, values in few.items()}
    path = predict_clouds(world, tmp_path / "p", {"yard": true_points("yard")})
    save(path / "yard.cameras.npz", few)
    values = world.score(path).result.scenes["yard"]
    assert values["cameras_placed"] == 0.5
    assert values["pose_auc_30deg"] == pytest.approx(6 / 30, abs=1e-6)
    two = {name: values[:2] for name, values in few.items()}
    save(path / "yard.cameras.npz", two)
    chosen = world.protocol(tmp_path / "c.toml", alignment={"method": "none"})
    values = world.score(path, protocol=str(chosen)).result.scenes["yard"]
    assert np.isinf([values["ate_m"], values["rpe_m"], values["rpe_deg"]]).all()


def test_ate_sees_the_cameras_that_the_alignment_left_out(world: World, tmp_path: Path) -> None:
    poses = camera_poses("yard")
    centres = poses.centres.copy()
    centres[0] += (0.0, 30.0, 0.0)
    extrinsics = np.concatenate([poses.rotation, -(poses.rotation @ centres[..., None])], axis=2)
    path = predict_clouds(world, tmp_path / "p", {"yard": true_points("yard")})
    save(path / "yard.cameras.npz", world.cameras("yard", extrinsics=extrinsics))
    scored = world.score(path).scored["yard"]
    assert scored.record["inlier_cameras"] == 5
    assert scored.record["chamfer_m"] < 1e-6
    fit = umeyama(centres, poses.centres, with_scale=True)
    left = np.linalg.norm(fit.apply(centres) - poses.centres, axis=1)
    assert scored.record["ate_m"] == pytest.approx(np.sqrt((left**2).mean()), rel=1e-9)


def test_a_scene_without_cameras_where_others_have_them(world: World, tmp_path: Path) -> None:
    values = with_poses(world, tmp_path, None)
    assert values["pose_auc_30deg"] == 0.0
    assert np.isinf([values["ate_m"], values["rpe_m"], values["rpe_deg"]]).all()
    assert values["f1_10m"] == 1.0


def test_no_pose_scores_where_no_scene_has_cameras(world: World, tmp_path: Path) -> None:
    path = predict_clouds(world, tmp_path / "p", {"lot": true_points("lot")}, cameras=False)
    assert "ate_m" not in world.score(path).result.overall


def test_every_kind_of_file_and_an_archive_score_alike(world: World, tmp_path: Path) -> None:
    points = true_points("lot")[::7] + np.array((0.0, 0.0, 0.25))
    folder = predict_clouds(world, tmp_path / "ply", {"lot": points}, cameras=False)
    save(tmp_path / "npz" / "lot.npz", {"points": points})
    (tmp_path / "npy" / "lot").mkdir(parents=True)
    np.save(tmp_path / "npy" / "lot" / "cloud.npy", points)
    with zipfile.ZipFile(tmp_path / "p.zip", "w") as archive:
        archive.write(folder / "lot.ply", "preds/lot.ply")
        archive.write(folder / "protocol.txt", "preds/protocol.txt")
    paths = [folder, tmp_path / "npz", tmp_path / "npy", tmp_path / "p.zip", folder / "lot.ply"]
    records = [world.score(path).scored["lot"].record for path in paths]
    assert all(record == records[0] for record in records)


# No number depends on the frame that a prediction happens to be in.


@pytest.mark.parametrize("method", ["sim3", "sim3+icp"])
@pytest.mark.parametrize("fusion", ["back-projection", "tsdf"])
def test_scores_do_not_depend_on_the_frame_of_the_prediction(
    method: str, fusion: str, world: World, tmp_path: Path
) -> None:
    fields = world.views("yard")
    random = np.random.default_rng(3)
    fields["depth"] = fields["depth"] * (1 + random.normal(0, 0.003, fields["depth"].shape))
    used = {"method": method, "icp_points": 5000, "icp_iterations": 10}
    chosen = world.protocol(tmp_path / "c.toml", alignment=used, fusion={"method": fusion})
    records = []
    for number, scale in enumerate((1.0, 0.003, 700.0)):
        other = fields | moved_cameras(world, "yard", scale, seed=number)
        other["depth"] = fields["depth"] * scale
        path = save(tmp_path / f"{number}" / "yard.npz", other).parent
        records.append(world.score(path, protocol=str(chosen)).scored["yard"].record)
    for record in records[1:]:
        assert record["points"] == records[0]["points"]
        for name in ("f1_0.2m", "f1_0.5m", "f1_1m", "pose_auc_3deg"):
            assert record[name] == pytest.approx(records[0][name], abs=1e-3), name
        for name in ("chamfer_m", "accuracy_m", "completeness_m", "ate_m"):
            assert record[name] == pytest.approx(records[0][name], rel=1e-4, abs=1e-6), name


# What cannot be bought: the shipped preparation against clouds that know nothing of the scene.


def bought(points: Array, **sections: Any) -> dict[str, Any]:
    """Return the record of a cloud in the yard by the shipped preparation and scores."""
    chosen = load_protocol(shipped_protocols()["photos-reconstruction"])
    assert isinstance(chosen, ReconstructionProtocol)
    shipped = chosen.model_dump()
    given = {name: shipped[name] for name in ("preparation", "scores")}
    given |= {"alignment": {"method": "none"}}
    for name, changes in sections.items():
        given[name] = given[name] | changes
    return scored(points, true_points("yard"), rules(**given)).record


PLAIN = {
    "preparation": {"crop": "none", "region": "all", "voxel_m": "none"},
    "scores": {"max_distance_m": "none"},
}


def sparse() -> Array:
    """Return an honest sparse cloud: every 40th true point, off by 0.2 m."""
    points = true_points("yard")[::40]
    return points + np.random.default_rng(0).normal(0, 0.2, points.shape)


def test_a_flood_with_one_true_point_many_times_over() -> None:
    along = np.arange(0.0, SIDE, 1.1)
    up = np.arange(-5.0, 25.0, 1.1)
    flood = np.stack(np.meshgrid(along, along, up), axis=-1).reshape(-1, 3) + ORIGIN
    cheat = np.concatenate([flood, np.repeat(true_points("yard")[:1], 800_000, axis=0)])
    assert bought(cheat, **PLAIN)["f1_1m"] > 0.9
    record = bought(cheat)
    assert record["f1_1m"] < 0.2
    assert bought(sparse())["f1_1m"] > 0.3


def test_a_flat_plane_through_the_scene() -> None:
    plane = ground(height=3.0) + ORIGIN
    assert bought(plane, **PLAIN)["f1_10m"] > 0.9
    cheat, honest = bought(plane), bought(sparse())
    assert honest["f1_10m"] >= cheat["f1_10m"]
    for limit in (1, 2):
        assert honest[f"f1_{limit}m"] > cheat[f"f1_{limit}m"] + 0.2
    assert honest["chamfer_m"] < cheat["chamfer_m"]


def test_one_point_at_the_end_of_the_world() -> None:
    far = np.concatenate([true_points("yard"), [[1e9, 1e9, 1e9]]])
    assert bought(far, **PLAIN)["chamfer_m"] > 10_000
    clipped = bought(far, preparation=PLAIN["preparation"])
    assert clipped["chamfer_m"] == pytest.approx(100 / 15_265 / 2, rel=1e-9)
    assert bought(far)["chamfer_m"] == 0.0  # it lies outside of what the truth covers


def test_points_that_decide_the_mean_are_named(world: World, tmp_path: Path) -> None:
    far = np.concatenate([true_points("yard"), [[1e9, 1e9, 1e9]]])
    path = predict_clouds(world, tmp_path / "p", {"yard": far})
    notes = world.score(path).result.notes
    assert any(
        "1 of 15,265 predicted points, up to 1.729e+09 m away, makes 100%" in n for n in notes
    )


def test_recall_is_over_what_the_photos_saw() -> None:
    points = true_points("yard")
    everywhere = bought(points)
    assert everywhere["f1_1m"] == 1.0
    assert 0 < everywhere["truth_unseen"] < everywhere["truth_points"]
    observed = observed_part(points)
    kept = bought(points[observed])
    # Voxels lie across the borders of cells, so that a few are lost.
    assert kept["recall_1m"] > 0.95
    over_all = bought(points[observed], preparation={"region": "all"})
    assert over_all["recall_1m"] < kept["recall_1m"] - 0.02


def observed_part(points: Array) -> Array:
    poses = camera_poses("yard")
    options = {"cell": 1.0, "hidden_beyond": 5.0, "photos": 2}
    cells = observed_cells([points], bounding_box(points), lenses(len(poses)), poses, **options)
    return cells.holds(points)


def test_rounded_coordinates_do_not_lie_on_borders_of_voxels() -> None:
    points = np.round(noisy()[60:], 2)
    exact, shaken = bought(points), bought(points + 1e-7)
    assert exact["points"] == shaken["points"]
    assert exact["chamfer_m"] == pytest.approx(shaken["chamfer_m"], abs=1e-6)


def test_voxels_wider_than_half_of_a_threshold_are_refused() -> None:
    with pytest.raises(ValidationError, match="must be at least two voxels"):
        protocol(preparation={"voxel_m": 0.5})


# Open3D as an oracle of distances, and a naive version of everything.


def test_open3d_finds_the_same_scores(world: World, tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    points = true_points("yard") + random.normal(0, 0.6, true_points("yard").shape)
    points = np.concatenate([points[::2], random.uniform(0, SIDE, (500, 3)) + ORIGIN])
    path = predict_clouds(world, tmp_path / "p", {"yard": points}, cameras=False)
    record = world.score(path).scored["yard"].record
    o3d = load_open3d()
    clouds = []
    for one in (points, true_points("yard")):
        cloud = o3d.geometry.PointCloud()
        cloud.points = o3d.utility.Vector3dVector(one - ORIGIN)
        clouds.append(cloud)
    there = np.asarray(clouds[0].compute_point_cloud_distance(clouds[1]))
    back = np.asarray(clouds[1].compute_point_cloud_distance(clouds[0]))
    for limit in (0.2, 0.5, 1.0, 10.0):
        p, r = (there < limit).mean(), (back < limit).mean()
        assert record[f"precision_{limit:g}m"] == p
        assert record[f"recall_{limit:g}m"] == r
        assert record[f"f1_{limit:g}m"] == pytest.approx(2 * p * r / (p + r), rel=1e-14)
    assert record["accuracy_m"] == pytest.approx(there.mean(), rel=1e-9)
    assert record["completeness_m"] == pytest.approx(back.mean(), rel=1e-9)
    assert record["chamfer_m"] == pytest.approx((there.mean() + back.mean()) / 2, rel=1e-9)
    assert record["accuracy_median_m"] == pytest.approx(np.median(there), rel=1e-7)


def rules(**sections: Any) -> ScoringSettings:
    chosen = protocol(**sections)
    return ScoringSettings(chosen.alignment, chosen.fusion, chosen.preparation, chosen.scores)


def scored(
    points: Array,
    truth: Array,
    used: ScoringSettings,
    *,
    block_points: int = 1 << 20,
    threads: int = 1,
) -> ScoredScene:
    poses = camera_poses("yard")
    cameras = PosedCameras(tuple("abcdef"), poses.centres, poses.rotation)
    claim, work = (
        MatchedPrediction("yard", InMemoryCloud(Cloud(points)), cameras),
        BlockWork(block_points, threads),
    )
    true = TrueScene(InMemoryCloud(Cloud(truth)), cameras, lenses(len(poses)))
    placed = align_scene(claim, true, used, work)
    return score_scene(claim, placed, cameras, used, work)


@quick
@given(seeds, st.sampled_from((1.0, 30.0, 1000.0)))
def test_the_naive_version_finds_the_same(seed: int, spread: float) -> None:
    random = np.random.default_rng(seed)
    counts = random.integers(1, 60, 2)
    points, truth = (random.uniform(0, spread, (count, 3)) + ORIGIN for count in counts)
    record = scored(points, truth, rules(alignment={"method": "none"})).record
    there, back = all_pairs(points, truth), all_pairs(truth, points)
    assert record["accuracy_m"] == pytest.approx(there.mean(), rel=1e-12)
    assert record["completeness_median_m"] == pytest.approx(np.median(back), rel=1e-12)
    for limit in (0.2, 1.0, 10.0):
        assert record[f"precision_{limit:g}m"] == (there < limit).mean()
        assert record[f"recall_{limit:g}m"] == (back < limit).mean()


# The same to the last bit.

VARIANTS: dict[str, dict[str, Any]] = {
    "sim3": {},
    "none": {"alignment": {"method": "none"}},
    "icp": {"alignment": {"method": "sim3+icp", "icp_points": 500_000, "icp_iterations": 5}},
    "box": {"preparation": {"crop": "box", "crop_margin_m": 2.0}},
    "covered": {"preparation": {"crop": "covered", "crop_margin_m": 2.0}},
    "observed": {"preparation": {"region": "observed"}},
    "voxels": {"preparation": {"voxel_m": 0.7}, "scores": {"f1_below_m": (2.0, 10.0)}},
}


def noisy(seed: int = 0) -> Array:
    random = np.random.default_rng(seed)
    points = true_points("yard") + random.normal(0, 0.4, true_points("yard").shape)
    points[:50] += 300.0
    points[50:60] = np.nan
    return points


@pytest.mark.parametrize("variant", list(VARIANTS))
def test_the_same_for_any_block_size_and_number_of_threads(variant: str) -> None:
    used = rules(**VARIANTS[variant])
    runs = [
        scored(noisy(), true_points("yard"), used, block_points=block, threads=threads)
        for block, threads in ((1 << 20, 1), (1 << 20, 2), (3000, 1), (3001, 3))
    ]
    pd.testing.assert_frame_equal(  # exact, NaN equal to NaN
        pd.DataFrame([run.record for run in runs[1:]]),
        pd.DataFrame([runs[0].record] * 3),
        check_exact=True,
    )
    for run in runs[1:]:
        assert run.curve is not None
        assert runs[0].curve is not None
        np.testing.assert_array_equal(run.curve.f1, runs[0].curve.f1)
        assert run.counts == runs[0].counts


@pytest.mark.parametrize("variant", ["sim3", "none", "box", "covered", "observed", "voxels"])
def test_the_same_for_any_order_of_points(variant: str) -> None:
    used, truth, points = rules(**VARIANTS[variant]), true_points("yard"), noisy()
    random = np.random.default_rng(1)
    one = scored(points, truth, used).record
    other = scored(random.permutation(points), random.permutation(truth), used).record
    pd.testing.assert_frame_equal(pd.DataFrame([one]), pd.DataFrame([other]), check_exact=True)


def test_the_command_scores_in_blocks_as_in_memory(world: World, tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    points = random.uniform(0, SIDE, (120_000, 3)) * (1, 1, 0.05) + ORIGIN
    path = predict_clouds(world, tmp_path / "p", {"yard": points})
    fields = world.views("lot")
    save(path / "lot.npz", fields)
    whole = world.score(path, jobs=1)
    blocks = world.score(path, jobs=2, memory_bytes=4 << 20)
    assert whole.records.to_csv() == blocks.records.to_csv()
    assert whole.result == blocks.result


@pytest.mark.parametrize("method", ["back-projection", "tsdf"])
def test_fusion_gives_the_same_bytes_again(method: str, world: World, tmp_path: Path) -> None:
    path = save(tmp_path / "p" / "yard.npz", world.views("yard")).parent
    chosen = world.protocol(tmp_path / "c.toml", fusion={"method": method})
    records = [
        world.score(path, protocol=str(chosen), jobs=jobs, memory_bytes=memory).records
        for jobs, memory in ((1, 1 << 30), (2, 1 << 30), (2, 2 << 20))
    ]
    assert records[0].to_csv() == records[1].to_csv() == records[2].to_csv()


# Errors fall as predictions get better.


def test_scores_fall_with_noise_holes_and_scale(world: World, tmp_path: Path) -> None:
    exact = true_points("yard")
    random = np.random.default_rng(2)
    offsets = random.normal(size=exact.shape)
    middle = exact.mean(axis=0)
    series = {
        "noise": [exact + offsets * size for size in (0.0, 0.3, 1.0, 3.0, 10.0)],
        "scale": [middle + (exact - middle) * (1 + s) for s in (0.0, 0.06, 0.15, 0.4)],
        "holes": [exact[exact[:, 0] < ORIGIN[0] + SIDE * s] for s in (1.0, 0.7, 0.4, 0.1)],
    }
    used = rules(alignment={"method": "none"})
    for name, clouds in series.items():
        records = [scored(points, exact, used).record for points in clouds]
        chamfer = [record["chamfer_m"] for record in records]
        f1 = [record["f1_1m"] for record in records]
        assert chamfer[0] == 0.0
        assert f1[0] == 1.0
        assert (np.diff(chamfer) > 0).all(), name
        assert (np.diff(f1) < 0).all(), name


def test_the_ground_of_the_made_world_is_a_grid() -> None:
    points = ground()
    assert len(points) == (SIDE / STEP) ** 2
    assert (np.unique(np.diff(np.unique(points[:, 0]))) == STEP).all()
