"""Distances, scores and voxels against SciPy and Open3D.

==========================================  =================================================
compared with                               tolerance
==========================================  =================================================
SciPy's cKDTree, Open3D's distances         relative 1e-15: the last bit of a sum or a root
Open3D's metrics, from float32 clouds       relative 1e-4; F1 in percent, Chamfer as a sum
Open3D's voxels                             the same number; means to 1e-12 of coordinates
==========================================  =================================================
"""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from scipy.spatial import cKDTree

from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.clouds import VoxelGrid
from airzoo_bench.reconstruction.distances import mutual_distances
from airzoo_bench.reconstruction.metrics import curve, mean_distances
from tests.reconstruction.world import surface

FAR = np.array((1_000_000.0, 4_000_000.0, 100.0))


@pytest.fixture(scope="module")
def o3d() -> ModuleType:
    return load_open3d()


def legacy(o3d: ModuleType, points: Floats) -> object:
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))


PAIRS = {
    "surfaces": (surface(6000, 0, far=0.05), surface(5000, 1)),
    "far from the origin": (surface(3000, 0) + FAR, surface(3000, 1) + FAR),
    "copies": (np.repeat(surface(300, 0), 10, axis=0), np.repeat(surface(300, 1), 10, axis=0)),
    "identical": (surface(2000, 0), surface(2000, 0)),
    "one point": (surface(2000, 0), surface(1, 1)),
    "all equal": (np.ones((500, 3)), np.zeros((500, 3))),
    "line": (np.linspace(0, 1, 700)[:, None] * FAR, np.linspace(0, 1, 900)[:, None] * FAR),
    "plane": (surface(2000, 0) * (1, 1, 0), surface(2000, 1) * (1, 1, 0)),
    "long and thin": (surface(2000, 0) * (1e4, 1, 1e-4), surface(2000, 1) * (1e4, 1, 1e-4)),
}


@pytest.mark.parametrize("name", PAIRS)
def test_distances_of_scipy(name: str) -> None:
    first, second = PAIRS[name]
    there, back = mutual_distances(first, second, jobs=2)
    np.testing.assert_allclose(there, cKDTree(second).query(first)[0], rtol=1e-15)
    np.testing.assert_allclose(back, cKDTree(first).query(second)[0], rtol=1e-15)


@pytest.mark.parametrize("name", PAIRS)
def test_distances_of_open3d(o3d: ModuleType, name: str) -> None:
    first, second = PAIRS[name]
    there, back = mutual_distances(first, second, jobs=2)
    one, other = legacy(o3d, first), legacy(o3d, second)
    np.testing.assert_allclose(there, one.compute_point_cloud_distance(other), rtol=1e-15)  # type: ignore[attr-defined]
    np.testing.assert_allclose(back, other.compute_point_cloud_distance(one), rtol=1e-15)  # type: ignore[attr-defined]


def open3d_metrics(
    o3d: ModuleType, truth: Floats, prediction: Floats, radii: tuple[float, ...]
) -> list[float]:
    """Chamfer, and F1 at each radius, as Open3D's tensor point clouds compute them."""
    metric = o3d.t.geometry.Metric
    one, other = (
        o3d.t.geometry.PointCloud(o3d.core.Tensor(points.astype(np.float32)))
        for points in (truth, prediction)
    )
    found: list[float] = (
        one.compute_metrics(
            other,
            [metric.ChamferDistance, metric.FScore],
            o3d.t.geometry.MetricParameters(fscore_radius=list(radii)),
        )
        .numpy()
        .tolist()
    )
    return found


@pytest.mark.parametrize("name", ["surfaces", "copies", "identical", "one point", "plane"])
def test_metrics_of_open3d(o3d: ModuleType, name: str) -> None:
    prediction, truth = PAIRS[name]
    radii = (0.3, 1.0, 10.0)
    both = mutual_distances(prediction, truth, jobs=2)
    means = mean_distances(*both, None)
    total, *shares = open3d_metrics(o3d, truth, prediction, radii)
    assert means["accuracy"] + means["completeness"] == pytest.approx(total, rel=1e-4)
    assert means["chamfer"] == pytest.approx(total / 2, rel=1e-4)
    f1 = curve(*both, np.array(radii)).f1
    assert (100 * f1).tolist() == pytest.approx(shares, rel=1e-3, abs=1e-3)


def test_cube_and_its_larger_copy_as_open3d_has_it(o3d: ModuleType) -> None:
    corners = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    total, *_ = open3d_metrics(o3d, corners, corners * 1.1, (0.1,))
    assert total == pytest.approx(2 * 0.1121837, abs=1e-6)
    there, back = mutual_distances(corners * 1.1, corners, jobs=1)
    assert np.mean(there) + np.mean(back) == pytest.approx(total, abs=1e-6)


@pytest.mark.parametrize(("size", "shift"), [(0.5, 0.0), (3.0, 0.0), (2.0, 1_000_000.0)])
def test_voxels_of_open3d(o3d: ModuleType, size: float, shift: float) -> None:
    points = surface(20_000, 0) + shift
    cloud = legacy(o3d, points)
    theirs = cloud.voxel_down_sample(size)  # type: ignore[attr-defined]
    # Open3D's grid begins half a voxel below the cloud.
    origin = points.min(axis=0) - size / 2.0
    grid = VoxelGrid(size, origin)
    grid.add(points)
    ours = grid.points()
    expected = np.asarray(theirs.points)
    order = np.lexsort(np.floor((expected - origin) / size).T[::-1])
    assert len(ours) == len(expected)
    np.testing.assert_allclose(ours, expected[order], rtol=1e-12, atol=1e-9)
