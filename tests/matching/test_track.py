"""The track end to end on a made world: what files may hold, scores, failures, refusals, notes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.poses import Poses, camera_to_world
from airzoo_bench.matching.predictions import PredictedPoses, read_matching
from tests.geometry.support import looking_down
from tests.matching.world import N_MATCHES, N_QUERIES, World, evaluated, matched, noisy

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
    assert any("@1m" in note and "@5m" not in note for note in result.notes)  # below 1.2 m
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


def test_settings_of_protocols(world: World, tmp_path: Path) -> None:
    """Rotations of failures, the fewest matches, the least height, pixel centres of the map."""
    sections: dict[str, Any] = {
        "scores": {"failed_rotation_deg": 180.0},
        "solver": {"least_matches": 5},
        "lift": {"heights_above_m": 105.0, "map_pixel_centres": "integer"},
    }
    whole = [xy - 0.5 for xy in world.map_xy]
    fields = world.correspondences(world.query_xy, map_xy=whole)
    rows = evaluated(world, tmp_path, fields, **sections).records
    low = [int((points[:, 2] <= 105.0).sum()) for points in world.points]
    assert (rows["no_height"] >= low).all()
    assert (rows["no_height"] + rows["lifted"] == N_MATCHES).all()
    assert 0 < rows["lifted"].sum() < N_QUERIES * N_MATCHES
    # Matches that count.
    high = [np.flatnonzero(points[:, 2] > 110.0) for points in world.points]
    chosen = [rows[:n] for rows, n in zip(high, (0, 4, 5, 9, 9), strict=True)]
    given = zip(world.query_xy, whole, chosen, strict=True)
    query_xy, map_xy = zip(*((xy[rows], there[rows]) for xy, there, rows in given), strict=True)
    fields = world.correspondences(query_xy, map_xy=map_xy)
    rows = evaluated(world, tmp_path, fields, **sections).records
    assert rows["lifted"].tolist() == [len(rows) for rows in chosen]
    assert rows["failed"].tolist() == [True, True, False, False, False]
    assert rows["rotation_deg"].tolist()[:2] == [180.0, 180.0]
    assert rows["error_m"].tolist()[:2] == [np.inf, np.inf]
    assert rows["error_m"][2:].max() < 1e-6


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


# --- predictions: files, and faults that users cannot see ---

IDS = ["hills/a", "hills/b"]
FILE = {"protocol": "photos-matching", "query_ids": IDS}
PIXELS = {"offsets": np.array([0, 2, 5]), "query_xy": np.arange(10.0).reshape(5, 2)}
MATCHES: dict[str, Any] = FILE | PIXELS | {"map_xy": np.arange(10.0, 20.0).reshape(5, 2)}
POINTS = np.arange(15.0).reshape(5, 3) + np.array((500_000, 5_200_000, 100))
PAIRS = FILE | PIXELS | {"points3d": POINTS}
CENTRES = np.array([[500_000.0, 5_200_000.0, 200.0], [500_010.0, 5_200_020.0, 210.0]])
TRUE = Poses.from_centres(np.concatenate([looking_down(10, 30), looking_down(20, 80)]), CENTRES)
RT = np.concatenate([TRUE.rotation, TRUE.translation[:, :, None]], axis=2)
POSES = FILE | {"poses": RT}
CENTRED = FILE | {"rotations": TRUE.rotation, "centres": CENTRES}
# A quarter turn about x: y becomes z. With t = (1, 2, 3) the centre is -R^T t = (-1, -3, 2).
TURN = f"{0.5**0.5!r} {0.5**0.5!r} 0 0 1 2 3"


def read(folder: Path, given: Any) -> Any:
    """Read fields of an npz, or lines of poses."""
    path = folder / ("p.txt" if isinstance(given, str) else "p.npz")
    if isinstance(given, str):
        path.write_text(given, encoding="utf-8")
    else:
        np.savez(path, **{key: np.asarray(value) for key, value in given.items()})
    return read_matching(path, 1 << 20)


def test_matches_and_pairs_are_read_as_they_are(tmp_path: Path) -> None:
    sized = MATCHES | {"image_size": np.array([[64, 48], [32, 24]])}
    found = read(tmp_path, sized | {"map_frame": "crop"})
    assert (found.protocol, found.query_ids.tolist()) == ("photos-matching", IDS)
    for name in sized.keys() - FILE.keys():
        np.testing.assert_array_equal(getattr(found.content, name), sized[name])
    assert (found.content.kind, found.content.map_frame) == ("matches", "crop")
    assert read(tmp_path, PAIRS).content.kind == "pairs"
    none = {"offsets": [0, 0, 0], "query_xy": np.zeros((0, 2)), "map_xy": np.zeros((0, 2))}
    assert read(tmp_path, MATCHES | none).content.kind == "matches"


def test_poses_are_world_to_camera_and_nan_is_none(tmp_path: Path) -> None:
    values = RT.copy()
    values[1] = np.nan
    for fields in (POSES | {"poses": values}, CENTRED):
        content = read(tmp_path, fields).content
        assert isinstance(content, PredictedPoses)
        assert content.has_pose.tolist() == [True, "centres" in fields]
        np.testing.assert_allclose(content.poses.centres[0], CENTRES[0], rtol=0, atol=1e-8)


def test_lines_become_poses(tmp_path: Path) -> None:
    found = read(
        tmp_path,
        f"# name q t\n\n  # more\nhills/a.b.jpg {TURN}\n hills/DJI  01.PNG 1 0 0 0 4 5 6\n"
        f"hills/2024.10.02 1 0 0 0 0 0 0\nhills/c {'nan ' * 7}\n",
    )
    names = ["hills/a.b", "hills/DJI  01", "hills/2024.10.02", "hills/c"]
    assert found.query_ids.tolist() == names
    assert found.content.has_pose.tolist() == [True, True, False, False]
    centres, rotation = found.content.poses.centres, found.content.poses.rotation[0]
    np.testing.assert_allclose(centres[:2], [[-1, -3, 2], [-4, -5, -6]], atol=1e-12)
    np.testing.assert_allclose(rotation, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)


# --- faults that show beside the truth only ---


Fields = dict[str, Any]


def moved_points(world: World, change: Callable[[Any], Any]) -> Fields:
    return world.correspondences(world.query_xy, points3d=[change(xyz) for xyz in world.points])


def centred(world: World, change: Callable[[Any], Any] = np.array, rotation: Any = None) -> Fields:
    true = world.truth.poses
    rotations = true.rotation if rotation is None else rotation
    return world.named(rotations=rotations, centres=change(true.centres))


def in_crops(world: World, change: Callable[[Any], Any]) -> Fields:
    """Return matches in pixels of the crops, which are changed."""
    places = zip(world.map_xy, world.truth.crops[:, :2], strict=True)
    return world.correspondences(world.query_xy, map_xy=[change(xy - at) for xy, at in places])


def poor(world: World, seed: int) -> list[Fields]:
    rng, true = np.random.default_rng(seed), world.truth.poses
    crops = [crop[:2] + rng.random((60, 2)) * crop[2:] for crop in world.truth.crops]
    turn = Rotation.from_euler("z", (5.0, 90.0, 180.0)[seed], degrees=True).as_matrix()
    return [
        world.correspondences(world.query_xy, map_xy=crops),
        moved_points(world, lambda xyz: xyz + rng.normal(0, 40, xyz.shape)),
        centred(world, lambda xyz: xyz + rng.normal(0, 100, xyz.shape)),
        # Rough rotations that no other reading brings nearer are a method's own.
        centred(world, rotation=true.rotation @ turn),
        world.named(poses=np.full((N_QUERIES, 3, 4), np.nan)),
    ]


# By case: predictions, and what their note says, if they get one.
NOTED: dict[str, tuple[Callable[[World], list[Fields]], str]] = {
    "another datum": (
        lambda w: [centred(w, lambda xyz: xyz + np.array((0.1, 0.2, 31.0)))],
        "(+0.1, +0.2, +31.0) m",
    ),
    "smaller crops": (
        lambda w: [in_crops(w, lambda xy: xy / 2) | {"map_frame": np.array("crop")}],
        "scene hills: no match lies beyond 60% of the crops'",
    ),
    **{f"poor {seed}": (lambda w, seed=seed: poor(w, seed), "") for seed in range(3)},
}


@pytest.mark.parametrize("case", NOTED)
def test_what_may_be_meant_is_noted_and_poor_answers_are_not(
    world: World, tmp_path: Path, case: str
) -> None:
    make, note = NOTED[case]
    for fields in make(world):
        said = " | ".join(matched(world, tmp_path, fields).doubts)
        assert note in said
        assert bool(said) == bool(note)


def test_poses_that_are_all_shifted_alike_make_the_map_doubtful(
    world: World, tmp_path: Path
) -> None:
    fields = moved_points(world, lambda xyz: xyz + np.array((30.0, 0.0, 0.3)))
    said = " | ".join(evaluated(world, tmp_path, fields).result.notes)
    assert "(+30.0, -0.0, +0.3) m" in said.replace("+0.0", "-0.0")


@pytest.mark.parametrize(("decimals", "refused"), [(0, True), (1, False)])
def test_rounded_centres_are_refused_where_it_matters(
    world: World, tmp_path: Path, *, decimals: int, refused: bool
) -> None:
    places = world.truth.poses.centres + np.random.default_rng(0).random((N_QUERIES, 3))
    xyz = dict(zip(("x", "y", "z"), places.T, strict=True))
    real = replace(world, truth=replace(world.truth, queries=world.truth.queries.assign(**xyz)))
    fields = centred(world, lambda _: np.round(places, decimals))
    expected = pytest.raises(PredictionError, match="field 'centres'") if refused else nullcontext()
    with expected:  # beside 1 m, the finest threshold
        matched(real, tmp_path, fields)
    # Cameras of a made-up scene may be at whole metres, as they are here.
    assert not matched(world, tmp_path, centred(world)).doubts
