"""The truth of a scene: written, read back, and held to its checksum."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import SceneInputs, photo_table
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.rasters import RasterInfo
from airzoo_bench.reconstruction.truth import build_truth, read_truth
from tests.matching.world import made_cameras, made_poses
from tests.reconstruction.world import World, camera_poses, make_world, replace_cloud, true_points


@pytest.fixture
def world(tmp_path: Path) -> World:
    return make_world(tmp_path / "data")


def test_what_was_written_is_read(world: World) -> None:
    truth = read_truth(Benchmark.open(world.folder), "yard")
    assert truth.photos["image"].tolist() == world.images("yard")
    np.testing.assert_array_equal(truth.poses.centres, camera_poses("yard").centres)
    np.testing.assert_allclose(truth.poses.rotation, camera_poses("yard").rotation, atol=4e-9)
    assert truth.cloud == world.folder / "data" / "yard" / "cloud.ply"
    assert truth.excluded.empty


def test_the_fingerprint_covers_cloud_and_poses(world: World) -> None:
    folder = Benchmark.open(world.folder)
    one, other = (read_truth(folder, scene).fingerprint for scene in ("yard", "lot"))
    assert one != other
    replace_cloud(world, "yard", true_points("yard")[:-1])
    changed = read_truth(Benchmark.open(world.folder), "yard").fingerprint
    assert changed not in (one, other)
    replace_cloud(world, "yard", true_points("yard"))
    assert read_truth(Benchmark.open(world.folder), "yard").fingerprint == one


def inputs(folder: Path) -> SceneInputs:
    images = tuple(f"q{n}.png" for n in range(5))
    photos = photo_table("hills", images, made_cameras(), made_poses(), None, 100.0)
    dom = RasterInfo.__new__(RasterInfo)  # reconstruction does not look at the map
    return SceneInputs("hills", photos, "EPSG:32633", dom, folder / "dsm.tif", 100.0, ("z.png",))


def test_photos_that_are_not_chosen_and_those_without_a_pose_are_listed(tmp_path: Path) -> None:
    write_ply(tmp_path / "c.ply", Cloud(np.zeros((1, 3))))
    chosen = pd.Series([True, True, False, True, True])
    truth = build_truth(inputs(tmp_path), tmp_path / "c.ply", chosen)
    assert truth.photos["image"].tolist() == ["q0.png", "q1.png", "q3.png", "q4.png"]
    reasons = dict(zip(truth.excluded["image"], truth.excluded["reason"], strict=True))
    assert reasons == {
        "q2.png": "not among the photos of the reconstruction",
        "z.png": "no pose",
    }
