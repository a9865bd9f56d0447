"""ICP: what it refines, and what it reports."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.reconstruction.alignment import draw_points, refine
from airzoo_bench.reconstruction.similarity import Similarity
from tests.reconstruction.cloud_support import Pieces
from tests.reconstruction.posed_cameras import UTM, assert_same
from tests.reconstruction.world import protocol


def terrain(rng: np.random.Generator, count: int) -> np.ndarray:
    x, y = rng.uniform(0, 60, (2, count))
    return np.stack((x, y, 4 * np.sin(x / 6) * np.cos(y / 9)), axis=1)


def icp(
    predicted: np.ndarray, truth: np.ndarray, held: int = 1 << 20, **changes: Any
) -> tuple[Similarity, dict[str, Any]]:
    stated = {
        "icp_points": 2000,
        "icp_below_m": 2.0,
        "icp_iterations": 60,
        "icp_tolerance": 1e-6,
        "icp_with_scale": True,
        **changes,
    }
    settings = protocol(alignment=stated).alignment
    return refine(Pieces(predicted), Pieces(truth), settings, memory_points=held)


OFF = Similarity(
    1.01,
    Rotation.from_euler("xyz", (0.5, -0.4, 0.8), degrees=True).as_matrix(),
    UTM + np.array((0.4, -0.3, 0.5)),
    UTM,
)


def test_icp_refines_far_from_the_origin() -> None:
    cloud = terrain(np.random.default_rng(12), 20000) + UTM
    predicted = OFF.apply(cloud[:8000])
    found, report = icp(predicted, cloud)
    assert_same(found, OFF.inverse(), predicted[::50], 1e-3)
    assert report["before"]["cost"] > 0.3
    assert report["after"]["rmse"] < 1e-3
    assert (report["after"]["fitness"], report["points"]) == (1.0, 2000)
    again, _ = icp(predicted, cloud)
    assert again.matrix.tobytes() == found.matrix.tobytes()


@pytest.mark.parametrize("held", [1, 1 << 20])
def test_icp_is_the_same_whatever_is_held(held: int) -> None:
    cloud = np.rint(terrain(np.random.default_rng(12), 20000) * 4) / 4 + UTM  # many ties
    found, report = icp(OFF.apply(cloud[:8000]), cloud, held=held)
    whole, _ = icp(OFF.apply(cloud[:8000]), cloud, held=10**6)
    assert found.matrix.tobytes() == whole.matrix.tobytes()
    assert report["after"]["cost"] < report["before"]["cost"]


def test_icp_without_scale_keeps_it() -> None:
    cloud = terrain(np.random.default_rng(13), 5000)
    off = Similarity(1.02, np.eye(3), np.array((0.1, 0.2, 0.3)))
    found, report = icp(off.apply(cloud[:3000]), cloud, icp_with_scale=False)
    assert found.scale == 1.0
    assert report["after"]["cost"] < report["before"]["cost"]


def test_icp_figures_by_hand() -> None:
    truth = np.array(((0.0, 0, 0), (10, 0, 0), (0, 10, 0), (10, 10, 0)))
    predicted = truth + np.array(((0.0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 50)))
    _, report = icp(predicted, truth, icp_iterations=1)
    assert (report["before"]["fitness"], report["before"]["rmse"]) == (0.75, 1.0)
    assert report["before"]["cost"] == pytest.approx(((3 * 1 + 4) / 4) ** 0.5)


def test_points_are_drawn_by_the_seed_whatever_the_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.arange(3000.0).reshape(1000, 3)
    points[17] = np.nan
    some = draw_points(Pieces(points), 10, seed=1)
    assert len(some) == 10
    assert (np.diff(some[:, 0]) > 0).all()
    assert not np.array_equal(some, draw_points(Pieces(points), 10, seed=2))
    assert len(draw_points(Pieces(points), 2000, seed=1)) == 999
    monkeypatch.setattr("airzoo_bench.reconstruction.alignment._PART", 37)
    np.testing.assert_array_equal(some, draw_points(Pieces(points), 10, seed=1))
