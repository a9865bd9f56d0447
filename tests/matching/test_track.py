"""The track end to end on a made world: exact input, failures, order, what records hold."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rasterio import Affine
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.track import Run, Scored
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.poses import Poses, camera_to_world
from airzoo_bench.matching.scoring import score_scene
from airzoo_bench.tables.layouts import scenes_table
from tests.matching.world import (
    EAST,
    N_MATCHES,
    N_QUERIES,
    NORTH,
    World,
    evaluated,
    made_matching_protocol,
    make_world,
    matched,
    noisy,
    records,
)
from tests.support import run_main, write_raster

GIVEN = {"matches": "matches", "in_crops": "matches", "pairs": "pairs", "poses": "poses"}


@pytest.mark.parametrize("form", GIVEN)
def test_exact_input_has_no_error(world: World, tmp_path: Path, form: str) -> None:
    run = evaluated(world, tmp_path, getattr(world, form)())
    rows, result = run.records, run.result
    assert rows["query"].tolist() == world.ids
    assert rows["pitch_deg"].tolist() == world.truth.queries["pitch_deg"].tolist()
    for column in ("error_m", "horizontal_m", "vertical_m", "rotation_deg"):
        assert rows[column].max() < 1e-6
    assert not rows["failed"].any()
    assert result.predictions.kind == GIVEN[form]
    assert f"scored from {GIVEN[form]}" in result.notes
    assert result.truth.fingerprint == _fingerprint(world, tmp_path)
    assert result.overall["within_1m_1deg"] == 1.0
    if form != "poses":
        assert (rows[["matches", "lifted", "inliers"]] == N_MATCHES).all(axis=None)


def _fingerprint(world: World, folder: Path) -> str:
    return evaluated(world, folder, world.poses()).result.truth.fingerprint


@pytest.fixture
def failing(world: World) -> dict[str, Any]:
    """Return predictions that lack q0, have 3 matches of q1, and q2 off the map."""
    query_xy = [world.query_xy[1][:3], *world.query_xy[2:]]
    map_xy = [world.map_xy[1][:3], world.map_xy[2] - 1000, *world.map_xy[3:]]
    fields = world.correspondences(query_xy, map_xy=map_xy)
    return fields | {"query_ids": np.array(world.ids[1:])}


def test_failures_stay_in_median_and_denominator(
    world: World, tmp_path: Path, failing: dict[str, Any]
) -> None:
    run = evaluated(world, tmp_path, failing)
    rows, result = run.records, run.result
    assert rows["failed"].tolist() == [True, True, True, False, False]
    assert rows["status"].tolist() == [
        "missing from the predictions",
        "too few matches",
        "too few matches",
        "solved",
        "solved",
    ]
    for column in ("error_m", "horizontal_m", "vertical_m", "rotation_deg"):
        assert np.isposinf(rows[column][:3]).all()
    assert rows["matches"].tolist() == [0, 3, N_MATCHES, N_MATCHES, N_MATCHES]
    assert rows["outside_map"].tolist() == [0, 0, N_MATCHES, 0, 0]
    estimates = run.scored["hills"].details[1]
    assert np.isnan([one.centre for one in estimates[:3]]).all()
    assert [int(one.inliers.sum()) for one in estimates] == [0, 0, 0, 60, 60]
    for values in (result.scenes["hills"], result.overall, result.pooled):
        assert values["error_m"] == np.inf
        assert values["within_20m"] == values["within_1m_1deg"] == 0.4
        assert values["auc_20m"] == pytest.approx(0.4)
    counts = result.counts["hills"]
    assert (counts["queries"], counts["missing"], counts["failed"]) == (5, 1, 3)
    said = " | ".join(result.notes)
    assert "queries that the predictions lack, scored at their worst: 1 of 5 (" in said
    assert "2 answered queries have no pose (2 too few matches)" in said
    assert f"{N_MATCHES} of {3 + 3 * N_MATCHES} matches could not be lifted" in said
    assert f"were dropped: {N_MATCHES} outside the map" in said


def test_poses_that_were_not_found_are_failures(world: World, tmp_path: Path) -> None:
    fields = world.poses()
    fields["poses"][:3] = np.nan
    rows = records(world, tmp_path, fields)
    assert rows["status"].tolist() == ["no pose given"] * 3 + ["given"] * 2
    assert np.isposinf(rows["error_m"][:3]).all()


def test_outliers_and_what_they_cost(world: World, tmp_path: Path) -> None:
    map_xy = [xy.copy() for xy in world.map_xy]
    for xy in map_xy:
        xy[: N_MATCHES // 2] = xy[: N_MATCHES // 2][::-1] + 25.0
    run = evaluated(world, tmp_path, world.correspondences(world.query_xy, map_xy=map_xy))
    assert run.records["error_m"].max() < 1e-6
    for one in run.scored["hills"].details[1]:
        assert one.inliers.tolist() == [row >= N_MATCHES // 2 for row in range(N_MATCHES)]


def on_surface(world: World, folder: Path, heights: np.ndarray[Any, Any], **grid: Any) -> Scored:
    """Score exact matches on another surface model, a pixel 100 m unless `grid` says."""
    transform = Affine(100.0, 0, EAST, 0, -100.0, NORTH)
    dsm = write_raster(folder / "other.tif", heights, transform=transform, **grid)
    truth = replace(world.truth, maps=(replace(world.truth.maps[0], dsm=dsm),))
    predicted = matched(world, folder, world.matches())
    return score_scene(truth, predicted, world.protocol, Run())


def test_matches_off_the_surface_model(world: World, tmp_path: Path) -> None:
    rows = on_surface(world, tmp_path, np.full((1, 1, 1), 100.0, np.float32)).records
    assert (rows["outside_dsm"] == N_MATCHES).sum() >= 3
    assert (rows["outside_dsm"] + rows["lifted"] == N_MATCHES).all()
    assert np.isposinf(rows["error_m"][rows["lifted"] == 0]).all()


def test_a_surface_model_without_heights(world: World, tmp_path: Path) -> None:
    nothing = np.full((1, 7, 7), -9999.0, np.float32)
    rows = on_surface(world, tmp_path, nothing, nodata=-9999.0).records
    assert (rows["no_height"] == N_MATCHES).all()
    assert rows["failed"].all()


def test_records_do_not_depend_on_order_or_workers(world: World, tmp_path: Path) -> None:
    written = {}
    for name, order, jobs in (("a", [0, 1, 2, 3, 4], 1), ("b", [3, 0, 4, 2, 1], 3)):
        path = world.write(tmp_path / f"{name}.npz", noisy(world, order))
        out = tmp_path / name
        command = ("eval", "matching", path, "--data", world.root, "--out", out, "--jobs", jobs)
        assert run_main(*command, "--format", "json") == 0
        assert {p.name for p in out.iterdir()} == {"result.json", "records.csv", "timings.csv"}
        written[name] = (out / "records.csv").read_bytes()
    assert written["a"] == written["b"]
    rows = pd.read_csv(tmp_path / "a" / "records.csv")
    assert rows["error_m"].between(1e-3, 5.0).all()
    assert "seconds" not in rows.columns
    timings = pd.read_csv(tmp_path / "a" / "timings.csv")
    assert timings["query"].tolist() == world.ids
    assert (timings["seconds"] > 0).all()


def test_ids_of_another_benchmark(world: World, tmp_path: Path) -> None:
    fields = world.matches(query_ids=np.array([f"City/{q}" for q in range(N_QUERIES)]))
    with pytest.raises(PredictionError, match="none of its query ids belongs") as caught:
        records(world, tmp_path, fields)
    assert "hills/q0" in str(caught.value)
    more = world.poses()
    more["query_ids"] = np.array([*world.ids[:4], "hills/unknown"])
    result = evaluated(world, tmp_path, more).result
    assert (result.extra_queries, result.counts["hills"]["missing"]) == (1, 1)


def test_without_trusted_orientation_there_is_no_pose_recall(tmp_path: Path) -> None:
    world = make_world(tmp_path, made_matching_protocol("airzoo-real-matching"))
    run = evaluated(world, tmp_path, world.matches())
    titles = [column.title for column in scenes_table(run.result).columns]
    assert titles == ["Scene", "Queries", "Median", "@5m", "@10m", "@20m"]
    assert not any("deg" in column for column in run.records.columns[:-1])
    assert not any("deg" in score for score in run.result.overall)


def test_infinity_survives_json(world: World, tmp_path: Path, failing: dict[str, Any]) -> None:
    path = world.write(tmp_path / "m.npz", failing)
    out = tmp_path / "out"
    assert run_main("eval", "matching", path, "--data", world.root, "--out", out) == 0
    result = json.loads((out / "result.json").read_text())
    assert result["overall"]["error_m"] == "Infinity"
    assert pd.read_csv(out / "records.csv")["error_m"].tolist()[:3] == [np.inf] * 3
    assert run_main("table", out / "result.json") == 0


def test_the_rotation_of_a_failure_and_fewest_matches_are_the_protocols(tmp_path: Path) -> None:
    world = make_world(
        tmp_path,
        made_matching_protocol(scores={"failed_rotation_deg": 180.0}, solver={"least_matches": 5}),
    )
    counts = [0, 4, 5, N_MATCHES, N_MATCHES]
    query_xy = [xy[:n] for xy, n in zip(world.query_xy, counts, strict=True)]
    map_xy = [xy[:n] for xy, n in zip(world.map_xy, counts, strict=True)]
    rows = records(world, tmp_path, world.correspondences(query_xy, map_xy=map_xy))
    assert rows["failed"].tolist() == [True, True, False, False, False]
    assert rows["rotation_deg"].tolist()[:2] == [180.0, 180.0]
    assert rows["error_m"].tolist()[:2] == [np.inf, np.inf]
    assert rows["lifted"].tolist()[1] == 4


@pytest.mark.parametrize("limit", [100.0, 105.0])
def test_heights_that_do_not_count_are_dropped(tmp_path: Path, limit: float) -> None:
    world = make_world(tmp_path, made_matching_protocol(lift={"heights_above_m": limit}))
    rows = records(world, tmp_path, world.matches())
    low = [int((points[:, 2] <= limit).sum()) for points in world.points]
    assert (rows["no_height"] >= low).all()
    assert (rows["no_height"] + rows["lifted"] == N_MATCHES).all()
    assert 0 < rows["lifted"].sum() < N_QUERIES * N_MATCHES


def test_half_pixels_are_seen(tmp_path: Path, world: World) -> None:
    on_map = world.correspondences(world.query_xy, map_xy=[xy + 0.5 for xy in world.map_xy])
    # A pixel is 2 m: the estimate moves by 1 m to the east and 1 m to the south.
    assert (abs(records(world, tmp_path, on_map)["horizontal_m"] - 2**0.5) < 0.5).all()
    on_photo = world.correspondences([xy + 0.5 for xy in world.query_xy], map_xy=world.map_xy)
    # Half a pixel of f = 520 px is 0.055 degrees; 0.078 along the diagonal.
    assert records(world, tmp_path, on_photo)["rotation_deg"].between(0.03, 0.15).all()
    protocol = made_matching_protocol(lift={"map_pixel_centres": "integer"})
    other = make_world(tmp_path / "integer", protocol)
    shifted = other.correspondences(other.query_xy, map_xy=[xy - 0.5 for xy in other.map_xy])
    assert records(other, tmp_path, shifted)["error_m"].max() < 1e-6


# --- the prior itself ---------------------------------------------------------------------------


def test_the_prior_itself_is_a_reference(world: World, tmp_path: Path) -> None:
    run = evaluated(world, tmp_path, world.matches()).result
    priors = world.truth.priors
    copied = world.named(rotations=priors.rotation, centres=priors.centres)
    copy = evaluated(world, tmp_path, copied).result
    floor = run.references["Prior itself"]
    assert floor == copy.references["Prior itself"]
    # A copy is made orthonormal once more, which moves its last bit.
    for part, own in ((floor.overall, copy.overall), (floor.pooled, copy.pooled)):
        assert part == pytest.approx(own, rel=1e-9)
    off = np.linalg.norm(priors.centres - world.truth.poses.centres, axis=1)
    assert floor.overall["error_m"] == pytest.approx(np.median(off))
    for result, count in ((run, 0), (copy, N_QUERIES)):
        counts = result.counts["hills"]
        assert (counts["equal_to_prior"], counts["near_prior"]) == (count, count)
        assert any("5 of 5 answers equal" in note for note in result.notes) == bool(count)


@pytest.mark.parametrize(
    ("away", "degrees", "near"), [(0.04, 0.09, 5), (0.06, 0.0, 0), (0.0, 0.11, 0)]
)
@pytest.mark.parametrize("solved", [False, True])
def test_answers_about_the_prior_are_counted_however_they_are_given(
    world: World, tmp_path: Path, *, away: float, degrees: float, near: int, solved: bool
) -> None:
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    priors = world.truth.priors
    poses = Poses(
        rotation=turn @ priors.rotation, centres=priors.centres + np.array((away, 0.0, 0.0))
    )
    fields = world.named(rotations=poses.rotation, centres=poses.centres)
    if solved:  # rays of the pose itself, as pairs
        points = np.random.default_rng(0).uniform((-9, -9, 30), (9, 9, 50), (N_QUERIES, 40, 3))
        pixels = project(world.truth.cameras, points)
        fields = world.correspondences(list(pixels), points3d=list(camera_to_world(poses, points)))
    counts = evaluated(world, tmp_path, fields).result.counts["hills"]
    assert (counts["equal_to_prior"], counts["near_prior"]) == (0, near)


def test_priors_that_are_the_truth_are_no_reference(tmp_path: Path) -> None:
    world = make_world(tmp_path, made_matching_protocol(prior={"source": "truth"}))
    assert evaluated(world, tmp_path, world.matches()).result.references == {}
