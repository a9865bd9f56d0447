"""Which points are compared: regions, voxels, points that the photos saw; and their distances."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.checks import left_out_notes
from airzoo_bench.reconstruction.clouds import (
    PreparedCloud,
    VoxelGrid,
    bounding_box,
    cloud_of,
    covered_columns,
    find_crop,
    find_visible,
    observed_cells,
    prepare_cloud,
)
from airzoo_bench.reconstruction.distances import cloud_distances, mutual_distances
from airzoo_bench.reconstruction.settings import Preparation
from tests.geometry.support import looking_down, quick, seeds
from tests.reconstruction.world import UTM, all_pairs, clouds, sphere, surface


def settings(**changes: Any) -> Preparation:
    crop = {"crop": "none", "crop_margin_m": 1.0, "crop_cell_m": 1.0}
    region = {"region": "all", "observed_photos": 2, "observed_cell_m": 1.0, "hidden_beyond_m": 3.0}
    return Preparation(**(crop | region | {"voxel_m": "none"} | changes))


def thinned(points: Floats, size: float, step: int = 1 << 30, most: int | None = None) -> Floats:
    """Thin a cloud that is added in pieces."""
    grid = VoxelGrid(size, np.zeros(3), most)
    for start in range(0, len(points), step):
        grid.add(points[start : start + step])
    return grid.points()


def test_voxels_by_hand() -> None:
    points = np.array([(0.5, 0.5, 0.5), (-0.5, 0.0, 0.0), (0.75, 1.75, 0.0), (0.25, 1.25, 0.5)])
    assert thinned(points, 1.0).tolist() == [[-0.5, 0.0, 0.0], [0.5, 0.5, 0.5], [0.5, 1.5, 0.25]]


@given(clouds(), st.integers(0, 2**32 - 1), st.sampled_from((0.05, 0.1, 0.3, 1.0, 1e-9)))
@quick
def test_no_bit_depends_on_order_or_pieces(points: Floats, seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    shuffled, step = random.permutation(points), int(random.integers(1, len(points) + 1))
    assert thinned(shuffled, size, step).tobytes() == thinned(points, size).tobytes()


def test_voxels_beyond_the_limit_are_refused() -> None:
    points = np.random.default_rng(0).uniform(0, 10, (1000, 3))
    occupied = len(thinned(points, 1.0))
    assert len(thinned(points, 1.0, 300, occupied)) == occupied
    with pytest.raises(UsageError):
        thinned(points, 1.0, 300, occupied - 1)


def prepare(points: Floats, block: int, **changes: Any) -> PreparedCloud:
    """Prepare a cloud whose truth is two corners of the unit cube."""
    used, truth = settings(**changes), cloud_of(np.array(((0.0, 0, 0), (1, 1, 1))))
    region = find_crop(truth, bounding_box(truth), used, block)
    return prepare_cloud(cloud_of(points), used, region, block)


def points_of(cloud: PreparedCloud, points: int = 3) -> Floats:
    parts = [piece.points for piece in cloud.source.pieces(points)]
    assert all(len(part) <= points for part in parts)
    found = np.concatenate([np.zeros((0, 3)), *parts])
    assert len(found) == cloud.source.count
    return found


def test_points_left_out_are_counted() -> None:
    points = np.array([[0, 0, 0], [np.nan, 0, 0], [1, 2, np.inf], [5, 5, 5], [0, -1e200, 0]])
    cloud = prepare(points, 2)
    assert (cloud.not_finite, cloud.outside, cloud.thinned) == (3, 0, 0)
    told = [left_out_notes(replace(cloud, not_finite=n, distrusted=n)) for n in (0, 1)]
    assert list(map(len, told)) == [0, 2]
    np.testing.assert_array_equal(points_of(cloud), points[[0, 3]])
    # Voxels thin what the crop has left; they begin at 0.191 of 0.5.
    points = np.array([[0.2, 0.1, 0.1], [0.4, 0.1, 0.1], [0.7, 0.1, 0.1], [9, 9, 9.0]])
    cloud = prepare(points, 1, crop="covered", crop_margin_m=0.0, voxel_m=0.5)
    assert (cloud.outside, cloud.thinned) == (1, 1)
    np.testing.assert_allclose(points_of(cloud), [[0.3, 0.1, 0.1], [0.7, 0.1, 0.1]], atol=1e-9)


@quick
@given(seeds)
def test_a_covered_region_holds_what_is_within_its_margin(seed: int) -> None:
    random = np.random.default_rng(seed)
    points, others = random.uniform(-9, 9, (5, 3)) + UTM, random.uniform(-40, 40, (2000, 3)) + UTM
    margin, size = float(random.uniform(0.5, 12)), 4.0
    held = covered_columns([points], size, bounding_box(cloud_of(points)), margin)(others)
    away = np.linalg.norm(others[:, None, :2] - points[None, :, :2], axis=-1).min(axis=1)
    low, high = points[:, 2].min() - margin, points[:, 2].max() + margin
    upright = (others[:, 2] >= low) & (others[:, 2] <= high)
    # All within the margin are held, and none that is two columns' diagonals farther.
    assert held[upright & (away < margin)].all()
    assert not held[(away > margin + 2 * size * np.sqrt(2)) | ~upright].any()


# --- the points that the photos saw ---

PLAIN = np.diag((400.0, 400.0, 1.0)) + np.eye(3, k=2) * 200 + np.eye(3, k=1) * ((0,), (150,), (0,))


def photos(*east: float) -> tuple[Cameras, Poses]:
    """Return photos of 400 x 300 pixels from 100 m above, so far in the east."""
    centres = UTM + np.array([(x, 0.0, 100.0) for x in east])
    rotation = np.tile(looking_down(0.0), (len(east), 1, 1))
    cameras = Cameras.from_matrices(np.tile(PLAIN, (len(east), 1, 1)), 400, 300)
    return cameras, Poses(rotation=rotation, centres=centres)


def level(height: float, half: float = 80.0) -> Floats:
    along = np.arange(-half + 0.5, half)
    x, y = np.meshgrid(along, along, indexing="ij")
    return np.stack((x.ravel(), y.ravel(), np.full(x.size, height)), axis=1) + UTM


def test_points_under_a_roof_and_outside_of_the_photo_are_hidden() -> None:
    ground, roof = level(0.0), level(12.0, half=8.0)
    x, y = np.abs(ground - UTM)[:, :2].T
    inside, border = (x < 50) & (y < 37.5), np.abs(y - 37.5) < 0.25
    seen = find_visible(ground, *photos(0.0), 1.0, 3.0)
    np.testing.assert_array_equal(seen[~border], inside[~border])
    seen = find_visible(np.concatenate((ground, roof)), *photos(0.0), 1.0, 3.0)
    # The roof, 8 m to each side, hides 9.1 m of the ground; a cell of the buffer is about 2 m wide.
    assert seen[len(ground) :].all()
    assert not seen[: len(ground)][(x < 7) & (y < 7)].any()
    assert seen[: len(ground)][inside & (y < 37) & ((x > 12) | (y > 12))].all()


def test_points_that_one_photo_sees_are_not_observed() -> None:
    points = level(0.0)
    given_all = (cloud_of(points), bounding_box(cloud_of(points)), *photos(-40.0, 40.0))
    found = observed_cells(*given_all, settings(), 1000)
    x, y = np.abs(points - UTM)[:, :2].T
    off = np.abs(y - 37.5) > 0.75  # the border of a photo
    off &= np.abs(x - 10) > 0.75
    np.testing.assert_array_equal(found.holds(points[off]), ((x < 10) & (y < 37.5))[off])
    with pytest.raises(BenchmarkError):
        observed_cells(*given_all, settings(observed_photos=3), 1000)


# --- distances: the same bits as all pairs, however the clouds lie ---


def assert_exact(first: Floats, second: Floats, *, on_disk: bool = False) -> None:
    found = mutual_distances(first, second, jobs=2, on_disk=on_disk)
    with np.errstate(over="ignore", under="ignore"):
        assert np.array_equal(found[0], all_pairs(first, second))
        assert np.array_equal(found[1], all_pairs(second, first))


def test_by_hand() -> None:
    points = np.array([(0.0, 0.0, 0.0), (3.0, 4.0, 0.0), (1.0, 2.0, 2.0)])
    others = np.array([(0.0, 0.0, 0.0), (3.0, 4.0, 12.0)])
    there, back = mutual_distances(points, others, jobs=1)
    assert there.tolist() == [0.0, 5.0, 3.0]
    assert back.tolist() == [0.0, np.sqrt(4 + 4 + 100)]


@given(clouds(60), clouds(60), st.booleans(), seeds)
@quick
def test_same_bits_as_all_pairs_in_any_order(points, others, on_disk, seed) -> None:
    assert_exact(points, others, on_disk=on_disk)
    random = np.random.default_rng(seed)
    order = random.permutation(len(points))
    found, _ = mutual_distances(points, others, jobs=1)
    again, _ = mutual_distances(points[order], random.permutation(others), jobs=3)
    assert np.array_equal(again, found[order])


@pytest.mark.parametrize("east", [0.01, 500.0, 1e7])
@pytest.mark.parametrize("scale", [1e-160, 1.0, 1e14, 1e140])
def test_points_however_far_or_near(east: float, scale: float) -> None:
    points, others = surface(400, 0, far=0.05), surface(400, 1, far=0.05)
    points[:20] *= scale
    others[: 400 if scale < 1 else 5] *= scale
    assert_exact(points + np.array((east, 0, 30)), others)


def grid(shift: float = 0.0) -> Floats:
    axis = np.arange(9) * 0.1 + shift
    return np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)


def middle() -> tuple[Floats, Floats]:
    """Return points on a sphere, and some in its middle, to which all are equally near."""
    random = np.random.default_rng(0)
    return sphere(random, 1000) * 1.2, random.normal(size=(50, 3)) * 1e-14


def test_ties_that_differ_in_their_last_bits_are_decided_exactly() -> None:
    # The middles of a grid's cells have eight neighbours, equally far up to the roundings.
    assert len(np.unique(all_pairs(grid() + 0.05, grid()))) > 2
    for both in ((grid() + 0.05, grid()), middle()):
        assert_exact(*both)


def test_many_copies_cost_no_more_than_one() -> None:
    same = np.zeros((50_000, 3))  # all pairs would be 2.5 10^9
    found, _ = mutual_distances(same + np.array((3.0, 4.0, 0.0)), same, jobs=2)
    assert found.tolist() == [5.0] * 50_000


@pytest.mark.parametrize("block_points", [100, 2000])
def test_sources_in_memory_or_on_disk_with_points_that_are_not_finite(block_points: int) -> None:
    prediction, truth = surface(1500, 0), surface(900, 1)
    prediction[7, 1], truth[800, 1] = np.nan, np.inf
    finite = np.delete(prediction, 7, axis=0), np.delete(truth, 800, axis=0)
    found = cloud_distances(
        cloud_of(prediction), cloud_of(truth), block_points=block_points, jobs=1
    )
    assert np.array_equal(found.to_truth, all_pairs(*finite))
    assert np.array_equal(found.to_prediction, all_pairs(*finite[::-1]))


@pytest.mark.parametrize("nothing", [np.zeros((0, 3)), np.full((9, 3), np.nan)])
def test_nothing_predicted_is_infinitely_far_and_no_truth_an_error(nothing: Floats) -> None:
    some = cloud_of(surface(5, 0))
    for block_points in (2, 2000):
        found = cloud_distances(cloud_of(nothing), some, block_points=block_points, jobs=1)
        assert (found.to_truth.tolist(), found.to_prediction.tolist()) == ([], [np.inf] * 5)
        with pytest.raises(BenchmarkError):
            cloud_distances(some, cloud_of(nothing), block_points=block_points, jobs=1)


@pytest.mark.parametrize("place", [np.nan, 1e10])
def test_a_true_cloud_has_places_on_earth(place: float) -> None:
    with pytest.raises(BenchmarkError, match="the true cloud"):
        bounding_box(cloud_of(np.full((2, 3), place)))
