"""Overlap of two sets, against hand-worked squares and against every pair by shapely."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.datasets.geometry_checks.splits import (
    NamedFootprints,
    cast_corners,
    compare_splits,
    read_footprints,
)
from airzoo_bench.retrieval.truth import ANCHOR_COLUMNS

from .analytic import ORIGIN, cameras, looking

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def footprints(*corners: tuple[float, float], size: float = 0.001) -> np.ndarray:
    return np.array(corners)[:, None] + size * SQUARE


def named(lonlat: np.ndarray, name: str) -> NamedFootprints:
    ids = tuple(f"{name}/{number}" for number in range(len(lonlat)))
    return NamedFootprints(ids, lonlat, np.zeros(len(lonlat), dtype=bool))


def pairs(train: np.ndarray, test: np.ndarray) -> list[tuple[int, int]]:
    found = compare_splits(named(train, "train"), named(test, "test"))
    rows = zip(found["train"], found["test"], strict=True)
    return [(int(a.removeprefix("train/")), int(b.removeprefix("test/"))) for a, b in rows]


def test_squares_worked_by_hand() -> None:
    train = footprints((10.0, 0.0), (11.0, 0.0), (10.0005, 0.0))
    test = footprints((10.0008, 0.0), (12.0, 0.0))
    found = compare_splits(named(train, "train"), named(test, "test"))
    assert found["train"].tolist() == ["train/0", "train/2"]
    assert found["share_of_test"].tolist() == pytest.approx([0.2, 0.7], abs=1e-6)
    metres = 0.001 * 111_195
    assert found["shared_m2"][0] == pytest.approx(0.2 * metres**2, rel=1e-4)


def test_touching_is_not_overlapping() -> None:
    train, test = footprints((10.0, 28.0)), footprints((10.001, 28.0), (10.0, 28.001))
    assert pairs(train, test) == []
    assert pairs(train, test - (1e-8, 1e-8)) == [(0, 0), (0, 1)]


def test_across_the_180th_meridian() -> None:
    train = footprints((179.9995, -40.0), (0.0, -40.0), (-179.9999, -40.0))
    for lon in (-180.0, 180.0, -179.9998):
        assert pairs(train, footprints((lon, -40.0))) == [(0, 0), (2, 0)]
    split = footprints((179.9995, -40.0))
    split[..., 0] = np.where(split[..., 0] > 180, split[..., 0] - 360, split[..., 0])
    assert pairs(train, split) == [(0, 0), (2, 0)]


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_same_pairs_as_every_pair_by_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    train, test = (
        rng.uniform(-1, 1, (n, 1, 2)) * 0.01 + rng.uniform(-1, 1, (n, 4, 2)) * 0.002
        for n in (30, 20)
    )
    hulls = [[shapely.MultiPoint(p).convex_hull for p in s] for s in (train, test)]
    shapes = [[shapely.Polygon(p) for p in s] for s in (train, test)]
    # Those that cross themselves count as their hull.
    shapes = [
        [s if s.is_valid else h for s, h in zip(*both, strict=True)]
        for both in zip(shapes, hulls, strict=True)
    ]
    expected = {
        (a, b)
        for a, one in enumerate(shapes[0])
        for b, other in enumerate(shapes[1])
        if one.intersection(other).area * 111_195**2 > 2e-4
    }
    assert set(pairs(train, test)) == expected


def test_nothing_where_a_photo_sees_no_ground_and_no_pass_where_it_is_not_known() -> None:
    train, test = footprints((10.0, 0.0)), footprints((10.0, 0.0))
    test[0] = np.nan
    assert pairs(train, test) == pairs(test, train) == []
    unknown = NamedFootprints(("test/0",), test, np.array([True]))
    assert unknown.unknown_ids == ["test/0"]


def test_corners_are_cast_and_cut(tmp_path: Path) -> None:
    from airzoo_bench.geometry.crs import from_lonlat
    from airzoo_bench.geometry.poses import Poses

    rotation = np.array([looking(0, 90), looking(0, 5), looking(0, -60), looking(0, 90)])
    centres = ORIGIN + np.array([(0, 0, 100.0), (0, 0, 100), (0, 0, 100), (0, 0, -1)])
    lonlat, unknown = cast_corners(
        cameras(4), Poses.from_centres(rotation, centres), "EPSG:4547", 0.0, 500.0
    )
    assert unknown.tolist() == [False, False, False, True]
    assert np.isnan(lonlat[2:]).all()
    ground = from_lonlat("EPSG:4547", lonlat[:2]) - ORIGIN[:2]
    half = 100 * np.array([80, 60]) / 130
    assert ground[0] == pytest.approx(
        half * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)]), abs=1e-3
    )
    # The upper corners of a level camera look at the sky: cut at 500 m along the ray.
    assert (np.hypot(*ground[1, :2].T) <= 500.0).all()
    assert (np.hypot(*ground[1, :2].T) > 400.0).all()


def test_wide_degrees_across_the_180th_meridian_near_a_pole() -> None:
    # At 89 degrees two degrees of longitude are 4 km: the test photo begins 1.1 degrees before.
    train = np.array((-178.6, 89.0)) + SQUARE[None] * (0.2, 0.01)
    test = np.array((178.9, 89.0)) + SQUARE[None] * (2.7, 0.01)
    assert pairs(train, test) == pairs(test, train) == [(0, 0)]
    turn = np.array((360.0, 0.0))
    assert pairs(test - turn, train + turn) == [(0, 0)]


def test_csv_in(tmp_path: Path) -> None:
    rows = footprints((10.0, 0.0), (10.0005, 0.0)).reshape(2, 8)
    table = pd.DataFrame(rows, columns=list(ANCHOR_COLUMNS)).assign(id=["007", "b"])
    table.to_csv(tmp_path / "train.csv", index=False)
    train = read_footprints(tmp_path / "train.csv", 100.0)
    assert train.ids == ("007", "b")
    assert len(compare_splits(train, train)) == 4
    table.assign(anchor0_lon=401_000.0).to_csv(tmp_path / "metres.csv", index=False)
    with pytest.raises(BenchmarkError, match="a number, at most 540 in size"):
        read_footprints(tmp_path / "metres.csv", 100.0)
