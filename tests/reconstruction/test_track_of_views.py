"""The whole track on depth and point maps, and on clouds of another frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import PredictionError
from tests.reconstruction.world import (
    ORIGIN,
    STEP,
    Array,
    World,
    camera_poses,
    predict_clouds,
    save,
    true_points,
)


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
    assert scored.records.to_dict("records")[0]["scale"] == pytest.approx(50.0, rel=1e-9)
    assert scored.records.to_dict("records")[0]["chamfer_m"] < 1e-6
    assert scored.records.to_dict("records")[0]["f1_0.2m"] == 1.0
    assert scored.alignment is not None
    np.testing.assert_allclose(scored.alignment.transform.rotation, turn.T, atol=1e-9)
    homogeneous = np.append(points[7], 1.0)
    back = scored.alignment.transform.matrix @ homogeneous
    np.testing.assert_allclose(back[:3], true_points("lot")[7], atol=1e-5)


@pytest.mark.parametrize("scale", [1.0, 0.02])
def test_photos_named_one_off_are_refused(world: World, tmp_path: Path, scale: float) -> None:
    fields = moved_cameras(world, "yard", scale) if scale != 1.0 else world.cameras("yard")
    fields["image_names"] = np.roll(fields["image_names"], 1)
    path = predict_clouds(world, tmp_path / "p", {"yard": moved(true_points("yard"), scale)[0]})
    save(path / "yard.cameras.npz", fields)
    with pytest.raises(PredictionError, match="one off") as caught:
        world.score(path)
    assert "scene yard" in str(caught.value)


def test_depth_maps_of_any_scale(world: World, tmp_path: Path) -> None:
    fields = world.views("lot") | moved_cameras(world, "lot", 0.1)
    fields["depth"] = fields["depth"] * 0.1
    record = (
        world.score(save(tmp_path / "p" / "lot.npz", fields).parent)
        .scored["lot"]
        .records.to_dict("records")[0]
    )
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
        world.score(save(tmp_path / name / "yard.npz", fields).parent)
        .scored["yard"]
        .records.to_dict("records")[0]
        for name, fields in (("depth", depth), ("points", given))
    ]
    assert records[0]["points"] == records[1]["points"] == 6 * 36 * 48
    for column in ("chamfer_m", "f1_0.2m", "f1_0.5m", "pose_auc_3deg"):
        assert records[0][column] == pytest.approx(records[1][column], abs=1e-3)


def test_fusing_keeps_the_surface_and_thins_it(world: World, tmp_path: Path) -> None:
    path = save(tmp_path / "p" / "yard.npz", world.views("yard")).parent
    chosen = world.protocol(tmp_path / "c.toml", fusion={"method": "tsdf"})
    record = world.score(path, protocol=str(chosen)).scored["yard"].records.to_dict("records")[0]
    plain = world.score(path).scored["yard"].records.to_dict("records")[0]
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
        .records.to_dict("records")[0]
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
    record = evaluation.scored["lot"].records.to_dict("records")[0]
    assert (record["points"], record["distrusted"]) == (conf.size // 2, conf.size // 2)
    assert any("left out: 3,456 points of too little" in n for n in evaluation.result.notes)


def test_icp_mends_poor_cameras(world: World, tmp_path: Path) -> None:
    cameras = world.cameras("yard")
    poses = camera_poses("yard")
    centres = poses.centres - np.array((0.0, 0.0, 0.7))
    cameras["extrinsics"][..., 3] = -(poses.rotation @ centres[..., None])[..., 0]
    path = predict_clouds(world, tmp_path / "p", {"yard": true_points("yard")})
    save(path / "yard.cameras.npz", cameras)
    rough = world.score(path).scored["yard"].records.to_dict("records")[0]
    icp = {"method": "sim3+icp", "icp_with_scale": False, "icp_points": 4000, "icp_tolerance": 1e-9}
    chosen = world.protocol(tmp_path / "c.toml", alignment=icp)
    scored = world.score(path, protocol=str(chosen)).scored["yard"]
    assert rough["chamfer_m"] > 0.1
    assert scored.records.to_dict("records")[0]["chamfer_m"] < 0.1 * rough["chamfer_m"]
    assert scored.alignment is not None
    assert scored.alignment.icp is not None


def test_icp_leaves_out_points_that_are_not_finite(world: World, tmp_path: Path) -> None:
    points = true_points("yard")
    points[::3] = np.nan
    path = predict_clouds(world, tmp_path / "p", {"yard": points})
    chosen = world.protocol(tmp_path / "c.toml", alignment={"method": "sim3+icp"})
    scored = world.score(path, protocol=str(chosen)).scored["yard"]
    assert scored.records.to_dict("records")[0]["accuracy_m"] < 1e-6
    assert scored.records.to_dict("records")[0]["not_finite"] == 5088
    assert scored.alignment is not None
    assert scored.alignment.icp is not None
    assert scored.alignment.icp.points == 15_264 - 5088
    assert scored.alignment.icp.after.fitness == 1.0


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
        records.append(
            world.score(path, protocol=str(chosen)).scored["yard"].records.to_dict("records")[0]
        )
    for record in records[1:]:
        assert record["points"] == records[0]["points"]
        for name in ("f1_0.2m", "f1_0.5m", "f1_1m", "pose_auc_3deg"):
            assert record[name] == pytest.approx(records[0][name], abs=1e-3), name
        for name in ("chamfer_m", "accuracy_m", "completeness_m", "ate_m"):
            assert record[name] == pytest.approx(records[0][name], rel=1e-4, abs=1e-6), name


@pytest.mark.parametrize("method", ["back-projection", "tsdf"])
def test_fusion_gives_the_same_bytes_again(method: str, world: World, tmp_path: Path) -> None:
    path = save(tmp_path / "p" / "yard.npz", world.views("yard")).parent
    chosen = world.protocol(tmp_path / "c.toml", fusion={"method": method})
    records = [
        world.score(path, protocol=str(chosen), jobs=jobs, memory_bytes=memory).records
        for jobs, memory in ((1, 1 << 30), (2, 1 << 30), (2, 2 << 20))
    ]
    assert records[0].to_csv() == records[1].to_csv() == records[2].to_csv()
