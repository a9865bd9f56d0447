"""Benchmarks from Python, nothing of the truth in them, and the examples that use them."""

from __future__ import annotations

import dataclasses
import runpy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import POSE_COLUMNS
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses, world_to_camera
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.retrieval.truth import read_truth as read_retrieval_truth
from tests.api.place import NAME, NAMES, PHOTO_SIZE, PRIOR_OFF_M, scored, true_poses
from tests.support import make_place, run_main, write_predictions

IDS = [f"{NAME}/{Path(name).with_suffix('').as_posix()}" for name in NAMES]
TRACKS = ("retrieval", "matching", "reconstruction")
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
# North-west corners of tiles that hold an anchor of each photo by more than 10 m.
SURE = {"park/a": (0, 0), "park/b": (128, 0), "park/c": (0, 128), "park/sub/d": (128, 128)}
# Of photo a, whose anchors lie at y = 31.19 and 96.81: from 5 m lower at 32.75 and 95.25.
DOUBTFUL = SURE | {"park/a": (0, 32)}


def truths(root: Path) -> tuple[Any, Any]:
    opened = Benchmark.open(root / "data" / NAME)
    retrieval = read_retrieval_truth(opened.scene_folder(NAME), NAME)
    return retrieval, read_matching_truth(opened, NAME)


def numbers_in(one: Any) -> list[float]:
    """Return every number in fields, items and arrays of an object."""
    if dataclasses.is_dataclass(one):
        one = vars(one)
    if isinstance(one, Mapping):
        one = [*one.values()]
    if isinstance(one, list | tuple):
        return [number for part in one for number in numbers_in(part)]
    array = np.asarray(one)
    return array.astype(float).ravel().tolist() if array.dtype.kind in "fiu" else []


def test_no_number_of_the_truth_is_given_to_a_method(root, field) -> None:
    (retrieval, matching), scene = truths(root), field.scene(NAME)
    secret = [
        matching.queries[[*POSE_COLUMNS, "altitude_m", "pitch_deg"]].to_numpy(),
        matching.poses.rotation,
        matching.poses.translation,
        retrieval.footprints.drop(columns="id").to_numpy(),
    ]
    numbers = np.round(np.unique(numbers_in(secret)), 7)
    numbers = numbers[(numbers % 1 != 0) & (np.abs(numbers) > 1e-6)]
    known = [scene.queries(), scene.photos(), scene.tiles(), scene.crops()]
    assert len(numbers) > 100
    assert len(numbers_in(known)) > 1000
    assert np.intersect1d(numbers, np.round(numbers_in(known), 7)).tolist() == []
    # Conditions that are numbers come from the true pose.
    assert "altitude_m" in matching.queries
    assert scene.photos()[0].conditions == {}


def test_photos(field) -> None:
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
    # The prior looks down where the camera is, to within its errors.
    assert third.prior.rotation[2, 2] < -0.9
    np.testing.assert_allclose(third.camera.K[:2, 2], np.array(PHOTO_SIZE) / 2)
    assert (third.camera.scaled(32, 24).width, third.camera.scaled(32, 24).K[0, 0]) == (32, 32.0)


def test_tiles(root, field) -> None:
    truth, _ = truths(root)
    tiles = field.scene(NAME).tiles()
    assert [tile.id for tile in tiles] == truth.tiles["id"].tolist()
    tile, row = tiles[7], truth.tiles.iloc[7]
    assert tile.box == tuple(row[["lon_min", "lat_min", "lon_max", "lat_max"]])
    window = tuple(int(row[name]) for name in ("x", "y", "width", "height"))
    np.testing.assert_array_equal(tile.image, read_rgb(root / "sources" / "dom.tif", window))
    assert tile.image.shape == (window[3], window[2], 3)


def test_crops(root, field) -> None:
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
    np.testing.assert_allclose(crop.to_world([[5.5, 3.0]]), [np.add(corner, (2.2, -1.2))])
    assert crop.to_map([[5.5, 3.0]]).tolist() == [[x + 5.5, y + 3.0]]


def test_points_of_a_crop_are_where_the_photo_shows_them(field) -> None:
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


def test_a_folder_is_opened_by_name_and_path(root: Path, data: Path, tmp_path: Path) -> None:
    assert load_benchmark(root / "data" / NAME).tracks == TRACKS
    assert load_benchmark(NAME, root / "data").scene(NAME).id == NAME
    made = load_benchmark("made").scenes[0]
    assert len(made.queries()) == 6
    for call, named in (
        (lambda: load_benchmark("nowhere"), "nowhere"),
        (lambda: load_benchmark(tmp_path), str(tmp_path)),
        (made.crops, "matching"),
        (made.photos, "reconstruction"),
    ):
        with pytest.raises(BenchmarkError, match=named):
            call()


@pytest.mark.parametrize(
    ("name", "track", "column", "least"),
    [
        ("retrieval_colours", "retrieval", "R@3", 90),  # chance: 30
        ("matching_sift", "matching", "@1m", 100),  # the prior itself: 0
        ("reconstruction_flat", "reconstruction", "F1@1m", 99),  # the ground is level
    ],
)
def test_example_methods(root, tmp_path, capsys, name, track, column, least) -> None:
    out = tmp_path / ("mine" if track == "reconstruction" else "mine.npz")
    runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"](NAME, f"{NAME}-{track}", str(out))
    assert float(scored(track, out, root / "data", capsys)[column]) >= least


@pytest.mark.slow
def test_the_example_of_a_tile_that_answers_at_another_height(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    assert run_main(*make_place(tmp_path / "sources").arguments()) == 0
    tiles = read_retrieval_truth(tmp_path / "data" / "park" / "scenes" / "park", "park").tiles
    ids = {(t.x, t.y): t.id for t in tiles.itertuples() if (t.width, t.height) == (64, 64)}
    for name, corners in {"sure": SURE, "doubtful": DOUBTFUL}.items():
        firsts = [ids[corner] for corner in corners.values()]
        ranked = [[first, *[t for t in ids.values() if t != first][:9]] for first in firsts]
        arrays = {"query_ids": list(corners), "ranked_ids": ranked}
        file = write_predictions(tmp_path / f"{name}.npz", "park-retrieval", **arrays)
        assert run_main("eval", "retrieval", file, "--out", tmp_path / name) == 0
    capsys.readouterr()
    main = runpy.run_path(str(EXAMPLES / "sensitivity.py"))["main"]
    main("park", tmp_path / "sure", tmp_path / "doubtful")
    said = capsys.readouterr().out
    assert "R@1: sure 100.00, doubtful 75.00, difference 25.00" in said
    assert "height 5 m: sure 100.00 to 100.00, doubtful 75.00 to 100.00" in said
    assert "height 5 m: the difference moves by up to 25.00, and is not larger" in said
