"""Structure from motion: its poses and points are right, and the same for any number of jobs."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates

from airzoo_bench.benchmark.queries import photo_table
from airzoo_bench.core.errors import UsageError
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.reconstruction import baseline
from airzoo_bench.reconstruction.alignment import PosedCameras, align
from airzoo_bench.reconstruction.baseline import Model, sparse_reconstruction
from airzoo_bench.reconstruction.info import SfmSettings
from tests.geometry.support import looking_down
from tests.reconstruction.world import ransac

UTM = np.array((576600.0, 5188100.0, 160.0))
SIZE = (320, 240)
SETTINGS = SfmSettings(
    long_side_px=320,
    max_features=800,
    peak_threshold=0.005,
    doubled=False,
    neighbours=5,
    max_error_px=2.0,
)


class Flight(NamedTuple):
    """A folder of photos, their table, and their true cameras."""

    folder: Path
    photos: pd.DataFrame
    truth: PosedCameras


def photo(camera: Cameras, pose: Poses, texture: np.ndarray) -> np.ndarray:
    """Render the ground at height 0 and a roof of 20 m x 20 m at height 6, of 10 pixels a metre."""
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    rays = rays_to_world(pose, back_project(camera, np.stack((x, y), axis=-1).reshape(1, -1, 2)))[0]
    centre = pose.centres[0] - UTM
    ground, roof = (centre + rays * ((h - centre[2]) / rays[:, 2])[:, None] for h in (0.0, 6.0))
    on_roof = (np.abs(roof[:, :2] - 30) < 10).all(axis=1)
    at = np.where(on_roof[:, None], roof + np.array((60.0, 0, 0)), ground)[:, :2]
    grey = map_coordinates(texture, at.T * 10 - 0.5, order=1, mode="grid-wrap")
    return np.clip(np.round(grey), 0, 255).astype(np.uint8).reshape(SIZE[1], SIZE[0])


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    rng = np.random.default_rng(0)
    texture = sum(
        gaussian_filter(rng.normal(size=(1200, 600)), s, mode="wrap") * s for s in (1.5, 4, 9)
    )
    texture = 128 + 50 * texture / texture.std()
    east, north = np.meshgrid((20.0, 28.0, 36.0), (24.0, 34.0))
    centres = UTM + np.stack((east.ravel(), north.ravel(), rng.uniform(29, 31, 6)), axis=1)
    K = [[[300.0, 0, 161.0], [0, 300.0, 119.0], [0, 0, 1]]] * 6
    cameras = Cameras.from_matrices(K, *SIZE, [[-0.05, 0.02, 0.001, -0.001, 0.0]] * 6)
    turns = np.concatenate([looking_down(5.0 * (row % 3), 10.0 * row) for row in range(6)])
    poses, folder = Poses(rotation=turns, centres=centres), tmp_path_factory.mktemp("flight")
    names = tuple(f"p {row}.png" for row in range(6))
    for row, name in enumerate(names):
        Image.fromarray(photo(cameras.take(row), poses.take(row), texture)).save(folder / name)
    table = photo_table("s", names, cameras, poses, poses, 160.0)
    return Flight(folder, table, PosedCameras(names, centres, turns))


@pytest.fixture(scope="module")
def made(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Model:
    work = tmp_path_factory.mktemp("work")
    return sparse_reconstruction(flight.folder, flight.photos, SETTINGS, work, Run())


def test_poses_and_points_are_right(flight: Flight, made: Model) -> None:
    assert made.names == list(flight.truth.names)
    poses = Poses.from_translations(made.extrinsics[..., :3], made.extrinsics[..., 3])
    posed = PosedCameras(flight.truth.names, poses.centres, poses.rotation)
    found = align(posed, flight.truth, ransac(inlier_below_m=0.5))
    # A hundredth of 300 px at 30 m is 0.1 pixel.
    assert found.values["centres"]["largest"] < 0.1
    assert found.values["rotations_deg"]["largest"] < 0.2
    points = found.transform.apply(made.points) - UTM
    assert len(points) > 200
    away = np.abs(points[:, :2] - 30).max(axis=1)
    assert np.median(np.abs(points[away < 9, 2] - 6)) < 0.1  # on the roof
    assert np.median(np.abs(points[away > 11, 2])) < 0.1


def test_jobs_change_no_byte(flight: Flight, made: Model, tmp_path: Path) -> None:
    again = sparse_reconstruction(flight.folder, flight.photos, SETTINGS, tmp_path, Run(jobs=2))
    assert again.points.tobytes() == made.points.tobytes()
    assert again.extrinsics.tobytes() == made.extrinsics.tobytes()


def test_photos_that_do_not_fit_give_an_empty_result(flight, tmp_path, monkeypatch) -> None:
    rng, photos = np.random.default_rng(1), flight.photos[:3].drop(columns="prior_qw")
    for name in photos["image"]:
        noise = gaussian_filter(rng.normal(128, 60, (240, 320, 3)), (2, 2, 0))
        Image.fromarray(noise.astype(np.uint8)).save(tmp_path / name)
    found: Any = sparse_reconstruction(tmp_path, photos, SETTINGS, tmp_path, Run())
    assert [len(part) for part in found] == [0, 0, 0]
    # A baseline without a pose at all is none.
    monkeypatch.setattr(baseline, "sparse_reconstruction", lambda *_: found)
    monkeypatch.setattr(baseline, "read_truth", lambda *_: flight)
    one, out = mock.Mock(id="s"), tmp_path / "out"
    with pytest.raises(UsageError):
        baseline.predict(mock.Mock(scenes=[one]), mock.Mock(), SETTINGS, out, Run(), print)
    assert not out.exists()
