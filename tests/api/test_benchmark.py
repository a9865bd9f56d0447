from __future__ import annotations

import dataclasses
import pickle
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import rasterio
from PIL import Image

from airzoo_bench.api.benchmark import BlindBenchmark, load_benchmark, photos_of
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import POSE_COLUMNS
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses, world_to_camera
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.retrieval.truth import read_truth as read_retrieval_truth
from tests.api.place import GROUND_M, NAME, NAMES, PHOTO_SIZE, PRIOR_OFF_M, true_poses
from tests.api.reached import numbers_of, reached

IDS = [f"{NAME}/{Path(name).with_suffix('').as_posix()}" for name in NAMES]


def truths(root: Path) -> tuple[Any, Any]:
    opened = Benchmark.open(root / "data" / NAME)
    retrieval = read_retrieval_truth(opened.scene_folder(NAME), NAME)
    return retrieval, read_matching_truth(opened, NAME)


def numbers_of_truth(root: Path) -> np.ndarray[Any, Any]:
    """Return numbers that only the truth has: poses in all spellings, what follows from them."""
    retrieval, matching = truths(root)
    poses = matching.poses
    parts = [
        matching.queries[[*POSE_COLUMNS, "altitude_m", "pitch_deg"]].to_numpy(),
        poses.rotation,
        poses.translation,
        retrieval.footprints.drop(columns="id").to_numpy(),
        retrieval.positives.overlap,
    ]
    numbers = np.unique(np.concatenate([np.ravel(part).astype(float) for part in parts]))
    return numbers[(numbers % 1 != 0) & (np.abs(numbers) > 1e-6)]


def test_nothing_of_the_truth_is_reached(root: Path, field: BlindBenchmark) -> None:
    secret = numbers_of_truth(root)
    assert len(secret) > 100
    objects = list(reached(field))
    shared = np.intersect1d(np.round(secret, 7), np.round(numbers_of(objects), 7))
    assert shared.tolist() == []
    texts = [str(one) for one in objects if isinstance(one, str | Path)]
    assert any("dom.tif" in text for text in texts)
    for word in ("cloud.ply", "positives", "overlaps", "footprint"):
        assert not [text for text in texts if word in text]
    kinds = {type(one).__name__ for one in objects}
    assert {"Photo", "Tile", "Crop", "Pose", "Camera"} <= kinds
    assert not {kind for kind in kinds if kind.endswith("Truth") or kind == "Positives"}


def test_the_walk_would_find_the_truth(root: Path) -> None:
    secret, (retrieval, matching) = numbers_of_truth(root), truths(root)
    for holder in (matching, {"rows": [retrieval.footprints]}, lambda: retrieval.positives.overlap):
        found = np.round(numbers_of(reached(holder)), 7)
        assert len(np.intersect1d(np.round(secret, 7), found)) > 20


def test_photos(field: BlindBenchmark) -> None:
    photos = field.scene(NAME).photos()
    assert [photo.id for photo in photos] == sorted(IDS)
    assert [photo.id for photo in field.scene(NAME).queries()] == sorted(IDS)
    third = photos[3]
    assert (third.name, third.id) == ("sub/c.png", f"{NAME}/sub/c")
    with Image.open(third.path) as image:
        np.testing.assert_array_equal(third.image, np.asarray(image))
    assert third.read(64).shape == (48, 64, 3)
    assert third.prior is not None
    _, centres = true_poses()
    np.testing.assert_allclose(third.prior.centre, centres[2] + PRIOR_OFF_M, atol=1e-3)
    # The prior looks down where the camera stands, to within its errors.
    assert third.prior.rotation[2, 2] < -0.9
    np.testing.assert_allclose(third.camera.K[:2, 2], np.array(PHOTO_SIZE) / 2)
    assert (third.camera.scaled(32, 24).width, third.camera.scaled(32, 24).K[0, 0]) == (32, 32.0)
    assert pickle.loads(pickle.dumps(third)).id == third.id  # noqa: S301 - our own bytes


def test_conditions_that_are_numbers_come_from_the_true_pose() -> None:
    table = pd.DataFrame({"id": ["s/a"], "image": ["a.jpg"], "weather": ["foggy"]})
    (photo,) = photos_of(table.assign(altitude_m=84.25, pitch_deg=70.5, speed_class=3), Path())
    assert photo.conditions == {"weather": "foggy"}
    assert photo.prior is None
    with pytest.raises(BenchmarkError, match="camera of s/a is not known"):
        _ = photo.camera


def test_a_photo_of_another_size_is_refused(field: BlindBenchmark, tmp_path: Path) -> None:
    other = dataclasses.replace(field.scene(NAME).photos()[0], path=tmp_path / "a.png")
    Image.new("RGB", (64, 48)).save(other.path)
    with pytest.raises(BenchmarkError, match="the photo is 64 x 48 px"):
        other.read()


def test_tiles(root: Path, field: BlindBenchmark) -> None:
    truth, _ = truths(root)
    tiles = field.scene(NAME).tiles()
    assert [tile.id for tile in tiles] == truth.tiles["id"].tolist()
    tile, row = tiles[7], truth.tiles.iloc[7]
    assert tile.box == tuple(row[["lon_min", "lat_min", "lon_max", "lat_max"]])
    window = tuple(int(row[name]) for name in ("x", "y", "width", "height"))
    np.testing.assert_array_equal(tile.image, read_rgb(root / "sources" / "dom.tif", window))
    assert tile.image.shape == (window[3], window[2], 3)
    assert [one.id for one in tiles[2:8:3]] == truth.tiles["id"].tolist()[2:8:3]
    assert repr(tiles) == f"<{len(tiles)} tiles>"


def test_crops(root: Path, field: BlindBenchmark) -> None:
    _, truth = truths(root)
    crops = field.scene(NAME).crops()
    assert [crop.query.id for crop in crops] == truth.queries["id"].tolist()
    assert [crop.window for crop in crops] == [tuple(row) for row in truth.crops.tolist()]
    crop = crops[1]
    with rasterio.open(root / "sources" / "dom.tif") as dom:
        x, y, width, height = crop.window
        whole = np.moveaxis(dom.read(), 0, -1)
        np.testing.assert_array_equal(crop.image, whole[y : y + height, x : x + width])
        corner = (dom.transform.c + 0.4 * x, dom.transform.f - 0.4 * y)
    assert crop.transform[:6] == pytest.approx((0.4, 0, corner[0], 0, -0.4, corner[1]))
    np.testing.assert_allclose(crop.to_world([[5.5, 3.0]]), [np.add(corner, (2.2, -1.2))])
    assert crop.to_map([[5.5, 3.0]]).tolist() == [[x + 5.5, y + 3.0]]
    assert crop.crs == "EPSG:32633"
    assert crop.heights.shape == (height, width)
    np.testing.assert_allclose(crop.heights, GROUND_M, atol=1e-4)


def test_points_of_a_crop_are_where_the_photo_shows_them(field: BlindBenchmark) -> None:
    """A pixel of a crop, lifted and seen from the true pose, has the colour of the photo there."""
    crop = next(crop for crop in field.scene(NAME).crops() if crop.query.name == "e.png")
    rotation, centres = true_poses()
    row = NAMES.index("e.png")
    xy = np.array([[crop.window[2] / 2 + 3.0, crop.window[3] / 2 - 7.5]])
    points = crop.to_points(xy)
    pose = Poses.from_centres(rotation[row : row + 1], centres[row : row + 1])
    camera = crop.query.camera
    batch = Cameras.from_matrices(camera.K[None], camera.width, camera.height)
    column, line = project(batch, world_to_camera(pose, points[None]))[0, 0]
    shown = crop.query.image[int(line), int(column)].astype(int)
    on_map = crop.image[int(xy[0, 1]), int(xy[0, 0])].astype(int)
    assert np.abs(shown - on_map).max() < 30


def test_open_by_folder_and_root(root: Path, tmp_path: Path) -> None:
    by_folder = load_benchmark(root / "data" / NAME)
    assert by_folder.tracks == ("retrieval", "matching", "reconstruction")
    assert load_benchmark(NAME, root / "data").scenes[0].id == NAME
    assert "scenes field" in repr(by_folder)
    with pytest.raises(BenchmarkError, match="is not there"):
        load_benchmark("nowhere")
    with pytest.raises(BenchmarkError, match="no benchmark folder here"):
        load_benchmark(tmp_path)
    with pytest.raises(BenchmarkError, match="no scene 'town'"):
        by_folder.scene("town")
    assert by_folder.scene(NAME).id == by_folder.scenes[0].id == NAME


def test_a_changed_file_is_refused(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root / "data" / NAME, tmp_path / NAME)
    queries = tmp_path / NAME / "scenes" / NAME / "queries.csv"
    queries.write_text(queries.read_text().replace("a.png", "z.png"))
    with pytest.raises(BenchmarkError, match="was changed"):
        load_benchmark(tmp_path / NAME)


def test_a_track_that_is_not_served(data: Path) -> None:
    scene = load_benchmark("made").scenes[0]
    assert len(scene.queries()) == 6
    with pytest.raises(BenchmarkError, match="does not serve matching"):
        scene.crops()
