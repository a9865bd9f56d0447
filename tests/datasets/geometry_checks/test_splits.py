"""Overlap of two sets, against hand-worked squares and against every pair by shapely."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.datasets.geometry_checks import (
    cast_corners,
    compare_splits,
    read_footprints,
)
from airzoo_bench.geometry.crs import from_lonlat
from airzoo_bench.retrieval.truth import ANCHOR_COLUMNS
from tests.support import run_main

from .analytic import CRS, ORIGIN, Flight, looking, orbit, scene, write_benchmark

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def footprints(*corners: tuple[float, float], size: float = 0.001) -> np.ndarray:
    return np.array(corners)[:, None] + size * SQUARE


def named(lonlat: np.ndarray) -> pd.DataFrame:
    ids = [str(number) for number in range(len(lonlat))]
    return pd.DataFrame(lonlat.reshape(-1, 8), ids, list(ANCHOR_COLUMNS))


def pairs(train: np.ndarray, test: np.ndarray) -> list[tuple[int, int]]:
    found = compare_splits(named(train), named(test))
    return [(int(a), int(b)) for a, b in zip(found["train"], found["test"], strict=True)]


def test_squares_worked_by_hand() -> None:
    train = footprints((10.0, 0.0), (11.0, 0.0), (10.0005, 0.0))
    test = footprints((10.0008, 0.0), (12.0, 0.0))
    found = compare_splits(named(train), named(test))
    assert found["train"].tolist() == ["0", "2"]
    assert found["share_of_test"].tolist() == pytest.approx([0.2, 0.7], abs=1e-6)
    assert found["shared_m2"][0] == pytest.approx(0.2 * (0.001 * 111_195) ** 2, rel=1e-4)
    touching = footprints((10.0, 28.0)), footprints((10.001, 28.0), (10.0, 28.001))
    assert pairs(*touching) == []
    assert pairs(touching[0], touching[1] - (1e-8, 1e-8)) == [(0, 0), (0, 1)]
    assert pairs(train, np.full((1, 4, 2), np.nan)) == []


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


def test_corners_are_cast_and_cut() -> None:
    rotation = np.array([looking(0, 90), looking(0, 5), looking(0, -60), looking(0, 90)])
    centres = np.array([(0, 0, 100.0), (0, 0, 100), (0, 0, 100), (0, 0, -1)])
    made = scene(Flight(rotation, centres))
    lonlat = cast_corners(made, 500.0)
    assert np.isnan(lonlat).any(axis=(1, 2)).tolist() == [False, False, True, True]
    ground = from_lonlat(CRS, lonlat[:2]) - ORIGIN[:2]
    half = 100 * np.array([80, 60]) / 130
    nadir = half * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])
    assert ground[0] == pytest.approx(nadir, abs=1e-3)
    # The upper corners of a level camera look at the sky: cut at 500 m along the ray.
    assert (np.hypot(*ground[1, :2].T) <= 500.0).all()
    assert (np.hypot(*ground[1, :2].T) > 400.0).all()
    with pytest.raises(BenchmarkError, match="no ground plane"):
        cast_corners(replace(made, plane_height_m=None), 500.0)


def test_tables_and_folders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = named(footprints((10.0, 0.0), (10.0005, 0.0))).assign(id=["007", "b"])
    table.to_csv(tmp_path / "train.csv", index=False)
    train = read_footprints(tmp_path / "train.csv", 100.0)
    assert [*train.index] == ["007", "b"]
    assert len(compare_splits(train, train)) == 4
    table.assign(anchor0_lon=401_000.0).to_csv(tmp_path / "metres.csv", index=False)
    with pytest.raises(BenchmarkError, match="a number, at most 540 in size"):
        read_footprints(tmp_path / "metres.csv", 100.0)
    flight = orbit(4)
    here = write_benchmark(tmp_path / "here", flight)
    away = replace(flight, centres=flight.centres + np.array((50_000, 0, 0)))
    assert run_main("check-split", here, write_benchmark(tmp_path / "there", away)) == 0
    assert run_main("check-split", here, here, "--out", tmp_path / "pairs.csv") == 1
    assert "f000" in capsys.readouterr().out
    found = pd.read_csv(tmp_path / "pairs.csv")
    assert found["test"].nunique() == len(flight.centres)
    assert found["train"][0] == "park/f000"
    table.assign(anchor0_lon="").to_csv(tmp_path / "unknown.csv", index=False)
    assert run_main("check-split", here, tmp_path / "unknown.csv") == 1
    for missing in (tmp_path, tmp_path / "no.csv"):
        assert run_main("check-split", missing, here) == 2
