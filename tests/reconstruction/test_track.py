"""The whole track on a made world: scores by hand, oracles, and sameness to the last bit."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from tests.reconstruction.both_scenes import notes_of
from tests.reconstruction.world import (
    ORIGIN,
    SIDE,
    STEP,
    Array,
    World,
    predict_clouds,
    save,
    true_points,
)

NEAR = 1e-8  # of coordinates of millions of metres, after an alignment


def lot(world: World, folder: Path, points: Array, **sections: Any) -> dict[str, Any]:
    """Return the record of the lot for predicted points, taken as they stand."""
    path = predict_clouds(world, folder / "p", {"lot": points}, cameras=False)
    chosen = world.protocol(folder / "c.toml", alignment={"method": "none"}, **sections)
    return world.score(path, protocol=str(chosen)).scored["lot"].records.to_dict("records")[0]


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


@pytest.mark.parametrize(("part", "said"), [(1000, None), (4, "20%"), (0.5, "67%")])
def test_the_share_outside_the_scored_region_is_printed(
    part: float, said: str | None, world: World, tmp_path: Path
) -> None:
    """Thinned by voxels inside, where four points become one; the share is of points as given."""
    points = true_points("lot")
    far = np.tile(points[:1] + np.array((0, 0, 900.0)), (int(len(points) / part), 1))
    path = predict_clouds(world, tmp_path / "p", {"lot": np.concatenate([points, far])})
    chosen = world.protocol(
        tmp_path / "c.toml",
        preparation={"crop": "covered", "voxel_m": 1.0},
        scores={"f1_below_m": (2.0,)},
    )
    found = [n for n in notes_of(world, path, str(chosen)) if "scored region" in n]
    assert [n.startswith(f"scene lot: {said} ") for n in found] == [True] * (said is not None)
    assert ["F1" in n for n in found] == [said == "67%"] * len(found)


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


@pytest.mark.parametrize("fault", ["2 cameras", "no camera", "one point", "no names", "NaN"])
def test_a_failed_scene_scores_its_worst_and_is_named(
    fault: str, world: World, tmp_path: Path
) -> None:
    path = predict_clouds(world, tmp_path / "p", {s: true_points(s) for s in ("yard", "lot")})
    lot = world.score(path).result.scenes["lot"]
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
    assert result.scenes["lot"] == lot
    failed = result.scenes["yard"]
    assert [failed[f"{what}_10m"] for what in ("precision", "recall", "f1")] == [0.0, 0.0, 0.0]
    assert np.isinf([failed["chamfer_m"], failed["accuracy_m"], failed["completeness_m"]]).all()
    assert failed["cameras_placed"] == (fault == "NaN")
    assert result.counts["yard"].get("failed", 0) == (fault != "NaN")
    assert any(note.startswith("scene yard: ") for note in result.notes)
    assert notes_of(world, path) == list(result.notes)


def test_the_average_is_unweighted(world: World, tmp_path: Path) -> None:
    clouds = {"lot": true_points("lot") + np.array((0, 0, 20.0)), "yard": true_points("yard")}
    path = predict_clouds(world, tmp_path / "p", clouds, cameras=False)
    result = world.score(path).result
    assert result.overall["f1_10m"] == 0.5
    assert result.overall["chamfer_m"] == 10.0


def test_a_mesh_is_sampled(world: World, tmp_path: Path) -> None:
    corners = np.array([[0, 0], [SIDE, 0], [SIDE, SIDE], [0, SIDE]])
    lines = [f"v {x + ORIGIN[0]} {y + ORIGIN[1]} {ORIGIN[2]}" for x, y in corners]
    (tmp_path / "p").mkdir()
    (tmp_path / "p" / "lot.obj").write_text("\n".join([*lines, "f 1 2 3", "f 1 3 4\n"]))
    chosen = world.protocol(tmp_path / "c.toml", meshes={"points": 20_000})
    evaluation = world.score(tmp_path / "p", protocol=str(chosen))
    record = evaluation.scored["lot"].records.to_dict("records")[0]
    assert evaluation.result.predictions.kind == "mesh"
    assert record["points"] == 20_000
    assert record["f1_1m"] > 0.999
    assert any("20,000 points sampled" in note for note in evaluation.result.notes)


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
    records = [world.score(path).scored["lot"].records.to_dict("records")[0] for path in paths]
    assert all(record == records[0] for record in records)


def test_points_that_decide_the_mean_are_named(world: World, tmp_path: Path) -> None:
    far = np.concatenate([true_points("yard"), [[1e9, 1e9, 1e9]]])
    path = predict_clouds(world, tmp_path / "p", {"yard": far})
    notes = world.score(path).result.notes
    assert any(
        "1 of 15,265 predicted points, up to 1.729e+09 m away, makes 100%" in n for n in notes
    )


# Open3D as an oracle of distances.


def test_open3d_finds_the_same_scores(world: World, tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    points = true_points("yard") + random.normal(0, 0.6, true_points("yard").shape)
    points = np.concatenate([points[::2], random.uniform(0, SIDE, (500, 3)) + ORIGIN])
    path = predict_clouds(world, tmp_path / "p", {"yard": points}, cameras=False)
    record = world.score(path).scored["yard"].records.to_dict("records")[0]
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
