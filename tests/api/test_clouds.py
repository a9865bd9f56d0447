"""Clouds and cameras from Python: the records of the track, SciPy and evo, edges."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import airzoo_bench as ab
from airzoo_bench.api.arguments import shipped
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from tests.api.support import refused
from tests.reconstruction.world import (
    Array,
    World,
    camera_poses,
    make_world,
    predict_clouds,
    true_points,
)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world") / "data")


def noisy_lot(random: np.random.Generator) -> Array:
    points = true_points("lot")
    kept = points[points[:, 0] < points[:, 0].mean()]
    kept = kept[random.random(len(kept)) < 0.4] + random.normal(0, 1.0, (3,)) + (0, 0, 1.9)
    stray = random.uniform(-60, 120, (300, 3)) + points.mean(axis=0)
    return np.concatenate([kept, stray, [[np.nan] * 3]])


@pytest.mark.parametrize("threshold", [10.0, 2.0])
@pytest.mark.parametrize("plain", [False, True])
def test_scores_are_those_of_the_track(
    world: World, tmp_path: Path, threshold: float, plain: bool
) -> None:
    points = noisy_lot(np.random.default_rng(0))
    path = predict_clouds(world, tmp_path / "p", {"lot": points}, cameras=False)
    chosen = world.protocol(
        tmp_path / "c.toml",
        alignment={"method": "none", "cameras": "optional"},
        preparation={
            "crop": "none" if plain else "covered",
            "crop_margin_m": threshold,
            "crop_cell_m": threshold / 2,
            "region": "all",
            "voxel_m": "none" if plain else threshold / 20,
        },
        scores={
            "f1_below_m": (threshold,),
            "headline_below_m": threshold,
            "max_distance_m": 1e6 if plain else 10 * threshold,
        },
    )
    record = world.score(path, protocol=str(chosen)).scored["lot"].records.to_dict("records")[0]
    found = ab.cloud_scores(points, true_points("lot"), threshold, plain=plain)
    for name in ("f1", "precision", "recall"):
        assert found[name] == record[f"{name}_{threshold:g}m"]
    for name in ("chamfer", "accuracy", "completeness"):
        assert found[name] == record[f"{name}_m"]
    for name in ("not_finite", "outside", "thinned"):
        assert found[name] == record[name]
    assert len(found.to_truth) == record["points"]
    assert len(found.to_prediction) == record["truth_points"]
    assert 0 < found.f1 < 1
    assert (found.outside > 0) == (not plain)
    assert found.not_finite == 1


def test_the_defaults_are_those_of_all_shipped_protocols() -> None:
    rules = [load_protocol(path) for path in shipped_protocols().values()]
    chosen = [one for one in rules if isinstance(one, ReconstructionProtocol)]
    assert len(chosen) == 7
    for one in chosen:
        d, settings = one.scores.headline_below_m, one.preparation
        assert (settings.voxel_m, settings.crop_margin_m) == (d / 20, d)
        assert (settings.crop, settings.crop_cell_m) == ("covered", d / 2)
        assert one.scores.max_distance_m == 10 * d
        limit, seed = one.alignment.inlier_below_m, one.alignment.seed
        assert ab.align_cameras.__kwdefaults__ == {"robust": True, "inlier_m": limit, "seed": seed}
        assert one.alignment == shipped(
            "reconstruction", "alignment", cameras=one.alignment.cameras
        )


def test_plain_scores_are_those_of_scipy() -> None:
    random = np.random.default_rng(1)
    true, predicted = random.random((400, 3)) * 20, random.random((300, 3)) * 22
    found = ab.cloud_scores(predicted.tolist(), true, 1.5, plain=True)
    there, back = cKDTree(true).query(predicted)[0], cKDTree(predicted).query(true)[0]
    np.testing.assert_allclose(found.to_truth, there, rtol=1e-12)
    np.testing.assert_allclose(found.to_prediction, back, rtol=1e-12)
    precision, recall = (there < 1.5).mean(), (back < 1.5).mean()
    assert (found.precision, found.recall) == (precision, recall)
    assert found.f1 == pytest.approx(2 * precision * recall / (precision + recall), rel=1e-15)
    assert found.chamfer == pytest.approx((there.mean() + back.mean()) / 2, rel=1e-12)


def test_edges_of_clouds() -> None:
    true = [[0.0, 0, 0], [1, 0, 0]]
    empty = ab.cloud_scores([], true)
    assert (empty.f1, empty.precision, empty.recall, empty.chamfer) == (0.0, 0.0, 0.0, np.inf)
    same = ab.cloud_scores(true, true, 0.1)
    assert (same.f1, same.chamfer) == (1.0, 0.0)
    at_limit = ab.cloud_scores([[0.0, 0, 2]], [[0.0, 0, 0]], 2.0, plain=True)
    assert (at_limit.f1, at_limit.chamfer) == (0.0, 2.0)  # strictly below
    cloud = np.random.default_rng(0).random((100, 3)) * 20 + (5e5, 5e6, 0)
    assert ab.cloud_scores(cloud.astype(np.float32), cloud, threshold=10.0).f1 == 1.0
    local = (cloud - (5e5, 5e6, 0)).astype(np.float32)
    assert ab.cloud_scores(local, local, threshold=0.2).f1 == 1.0
    away = ab.cloud_scores([[0.0, 0, 0]], [[0.0, 0, 0], [900, 0, 0]], 1.0)
    assert away.completeness == 5.0  # one of two distances, clipped


def made(count: int = 12) -> tuple[Array, Array]:
    """Return centres in two frames."""
    random = np.random.default_rng(2)
    true = random.normal((500_000, 5_200_000, 100), (60, 40, 8), (count, 3))
    turn = Rotation.random(random_state=3).as_matrix()
    return (true - true.mean(axis=0)) @ turn.T / 7.0, true


def test_the_plain_alignment_is_that_of_evo() -> None:
    geometry = pytest.importorskip("evo.core.geometry")
    predicted, true = made()
    true = true - true.mean(axis=0) + np.random.default_rng(4).normal(0, 3, true.shape)
    rotation, translation, scale = geometry.umeyama_alignment(predicted.T, true.T, True)
    found = ab.align_cameras(predicted, true, robust=False)
    assert found.scale == pytest.approx(scale, rel=1e-12)
    np.testing.assert_allclose(found.transform.rotation, rotation, atol=1e-12)
    np.testing.assert_allclose(found.matrix[:3, 3], translation, atol=1e-9)
    assert found.inliers.all()
    moved = found.transform.apply(predicted)
    np.testing.assert_allclose(found.residuals, np.linalg.norm(moved - true, axis=1))


def test_the_robust_alignment_is_that_of_the_track(world: World, tmp_path: Path) -> None:
    poses = camera_poses("yard")
    turn = Rotation.random(random_state=5).as_matrix()
    centres = (poses.centres - poses.centres[0]) @ turn.T / 4.0
    centres[2] += (9.0, 0, 0)
    rotation = poses.rotation @ turn.T
    translation = -np.einsum("nij,nj->ni", rotation, centres)
    extrinsics = np.concatenate([rotation, translation[:, :, None]], axis=2)
    points = (true_points("yard") - poses.centres[0]) @ turn.T / 4.0
    path = predict_clouds(world, tmp_path / "p", {"yard": points}, cameras=False)
    np.savez(
        path / "yard.cameras.npz", image_names=np.array(world.images("yard")), extrinsics=extrinsics
    )
    chosen = world.protocol(tmp_path / "c.toml", alignment={"method": "sim3"})
    of_track = world.score(path, protocol=str(chosen)).scored["yard"].facts["alignment"]
    true = np.concatenate([poses.rotation, poses.translation[:, :, None]], axis=2)
    found = ab.align_cameras(extrinsics, true)
    assert found.inliers.tolist() == [True, True, False, True, True, True]
    assert of_track["inliers"] == 5
    np.testing.assert_allclose(found.matrix, of_track["matrix"], rtol=1e-6)
    assert found.scale == pytest.approx(4.0, rel=1e-6)
    lost = extrinsics.copy()
    lost[2] = np.nan
    again = ab.align_cameras(lost, true)
    assert again.residuals[2] == np.inf
    assert again.scale == pytest.approx(found.scale, rel=1e-9)
    plain = ab.align_cameras(lost, true, robust=False)
    assert plain.inliers.tolist() == [True, True, False, True, True, True]
    assert plain.residuals[2] == np.inf


def test_cameras_on_a_line_need_orientations() -> None:
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3] = -np.arange(5.0)
    true = poses.copy()
    true[:, 0, 3] *= 10.0
    found = ab.align_cameras(poses, true)
    assert found.used_orientations
    assert found.scale == pytest.approx(10.0)
    refused(ab.align_cameras, -poses[:, :3, 3], -true[:, :3, 3], where="predicted, true")
    refused(ab.align_cameras, poses, true, robust=False, where="predicted, true")
