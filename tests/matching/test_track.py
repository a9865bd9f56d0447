"""The track end to end on a made world: exact input, failures, order, what records hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.poses import Poses, camera_to_world
from tests.matching.world import (
    N_MATCHES,
    N_QUERIES,
    World,
    evaluated,
    made_matching_protocol,
    make_world,
    noisy,
)

GIVEN = {"matches": "matches", "in_crops": "matches", "pairs": "pairs", "poses": "poses"}
ERRORS = ["error_m", "horizontal_m", "vertical_m", "rotation_deg"]


@pytest.mark.parametrize("form", GIVEN)
def test_exact_input_has_no_error(world: World, tmp_path: Path, form: str) -> None:
    run = evaluated(world, tmp_path, getattr(world, form)())
    rows, result = run.records, run.result
    assert rows["query"].tolist() == world.ids
    assert rows["pitch_deg"].tolist() == world.truth.queries["pitch_deg"].tolist()
    assert rows[ERRORS].max().max() < 1e-6
    assert result.predictions.kind == GIVEN[form]
    assert result.overall["within_1m_1deg"] == 1.0
    assert not any("equal to the prior" in note for note in result.notes)
    if form != "poses":
        assert (rows[["matches", "lifted", "inliers"]] == N_MATCHES).all(axis=None)


def test_failures_stay_in_median_and_denominator(world: World, tmp_path: Path) -> None:
    # The predictions lack q0, have 3 matches of q1, and q2 off the map.
    query_xy = [world.query_xy[1][:3], *world.query_xy[2:]]
    map_xy = [world.map_xy[1][:3], world.map_xy[2] - 1000, *world.map_xy[3:]]
    fields = world.correspondences(query_xy, map_xy=map_xy)
    run = evaluated(world, tmp_path, fields | {"query_ids": np.array(world.ids[1:])})
    rows, result = run.records, run.result
    few, found = ["too few matches"] * 2, ["solved"] * 2
    assert rows["status"].tolist() == ["missing from the predictions", *few, *found]
    assert np.isposinf(rows[ERRORS][:3]).all(axis=None)
    counted = {"failed": [True] * 3 + [False] * 2, "inliers": [0, 0, 0, 60, 60]}
    counted |= {"matches": [0, 3, 60, 60, 60], "outside_map": [0, 0, 60, 0, 0]}
    assert {column: rows[column].tolist() for column in counted} == counted
    for values in (result.scenes["hills"], result.overall, result.pooled):
        assert values["error_m"] == np.inf
        assert values["within_20m"] == values["within_1m_1deg"] == 0.4
        assert values["auc_20m"] == pytest.approx(0.4)
    counts = result.counts["hills"]
    assert (counts["queries"], counts["missing"], counts["failed"]) == (5, 1, 3)
    said = " | ".join(result.notes)
    for part in ("1 of 5 (", "2 answered queries", f"{N_MATCHES} of {3 + 3 * N_MATCHES} matches"):
        assert part in said


def test_records_do_not_depend_on_order(world: World, tmp_path: Path) -> None:
    orders = [0, 1, 2, 3, 4], [3, 0, 4, 2, 1]
    rows, other = (evaluated(world, tmp_path, noisy(world, order)).records for order in orders)
    assert rows.to_csv() == other.to_csv()
    assert rows["error_m"].between(1e-3, 5.0).all()


# --- settings of protocols ----------------------------------------------------------------------


def world_of(folder: Path, **sections: Any) -> World:
    return make_world(folder, made_matching_protocol(**sections))


def test_failed_rotations_fewest_matches_and_heights_are_the_protocols(tmp_path: Path) -> None:
    own = {"scores": {"failed_rotation_deg": 180.0}, "solver": {"least_matches": 5}}
    world = world_of(tmp_path, **own, lift={"heights_above_m": 105.0})
    rows = evaluated(world, tmp_path, world.matches()).records
    low = [int((points[:, 2] <= 105.0).sum()) for points in world.points]
    assert (rows["no_height"] >= low).all()
    assert (rows["no_height"] + rows["lifted"] == N_MATCHES).all()
    assert 0 < rows["lifted"].sum() < N_QUERIES * N_MATCHES
    # Matches that count.
    high = [np.flatnonzero(points[:, 2] > 110.0) for points in world.points]
    chosen = [rows[:n] for rows, n in zip(high, (0, 4, 5, 9, 9), strict=True)]
    query_xy, map_xy = (
        [xy[rows] for xy, rows in zip(given, chosen, strict=True)]
        for given in (world.query_xy, world.map_xy)
    )
    rows = evaluated(world, tmp_path, world.correspondences(query_xy, map_xy=map_xy)).records
    assert rows["lifted"].tolist() == [len(rows) for rows in chosen]
    assert rows["failed"].tolist() == [True, True, False, False, False]
    assert rows["rotation_deg"].tolist()[:2] == [180.0, 180.0]
    assert rows["error_m"].tolist()[:2] == [np.inf, np.inf]


def test_half_pixels_are_seen(tmp_path: Path, world: World) -> None:
    on_map = world.correspondences(world.query_xy, map_xy=[xy + 0.5 for xy in world.map_xy])
    # A pixel is 2 m: the estimate moves by 1 m to the east and 1 m to the south.
    assert (abs(evaluated(world, tmp_path, on_map).records["horizontal_m"] - 2**0.5) < 0.5).all()
    on_photo = world.correspondences([xy + 0.5 for xy in world.query_xy], map_xy=world.map_xy)
    # Half a pixel of f = 520 px is 0.055 degrees; 0.078 along the diagonal.
    assert evaluated(world, tmp_path, on_photo).records["rotation_deg"].between(0.03, 0.15).all()
    other = world_of(tmp_path / "integer", lift={"map_pixel_centres": "integer"})
    shifted = other.correspondences(other.query_xy, map_xy=[xy - 0.5 for xy in other.map_xy])
    assert evaluated(other, tmp_path, shifted).records["error_m"].max() < 1e-6


# --- the prior itself ---------------------------------------------------------------------------


def test_the_prior_itself_is_a_reference(world: World, tmp_path: Path) -> None:
    priors = world.truth.priors
    copied = world.named(rotations=priors.rotation, centres=priors.centres)
    copy = evaluated(world, tmp_path, copied).result
    floor = copy.references["Prior itself"]
    # A copy is made orthonormal once more, which moves its last bit.
    assert floor.overall == pytest.approx(copy.overall, rel=1e-9)
    assert floor.pooled == pytest.approx(copy.pooled, rel=1e-9)
    off = np.linalg.norm(priors.centres - world.truth.poses.centres, axis=1)
    assert floor.overall["error_m"] == pytest.approx(np.median(off))
    counts = copy.counts["hills"]
    assert (counts["equal_to_prior"], counts["near_prior"]) == (N_QUERIES, N_QUERIES)
    assert any("5 of 5 answers equal" in note for note in copy.notes)


@pytest.mark.parametrize(
    ("away", "degrees", "near"), [(0.04, 0.09, 5), (0.06, 0.0, 0), (0.0, 0.11, 0)]
)
@pytest.mark.parametrize("solved", [False, True])
def test_answers_about_the_prior_are_counted_however_they_are_given(
    world: World, tmp_path: Path, *, away: float, degrees: float, near: int, solved: bool
) -> None:
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    priors, east = world.truth.priors, np.array((away, 0.0, 0.0))
    poses = Poses(rotation=turn @ priors.rotation, centres=priors.centres + east)
    fields = world.named(rotations=poses.rotation, centres=poses.centres)
    if solved:  # rays of the pose itself, as pairs
        points = np.random.default_rng(0).uniform((-9, -9, 30), (9, 9, 50), (N_QUERIES, 40, 3))
        pixels = project(world.truth.cameras, points)
        fields = world.correspondences(list(pixels), points3d=list(camera_to_world(poses, points)))
    counts = evaluated(world, tmp_path, fields).result.counts["hills"]
    assert (counts["equal_to_prior"], counts["near_prior"]) == (0, near)
