"""The truth of a scene: which tile answers which photo, wherever it lies, however it is turned."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from rasterio import Affine

from airzoo_bench.benchmark.queries import SceneInputs, photo_table, write_queries
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.retrieval.prepare import PreparedScene, build_truth
from airzoo_bench.retrieval.ranking import Ranking
from airzoo_bench.retrieval.settings import GeometricRules, MapGallery
from airzoo_bench.retrieval.truth import read_truth, write_truth
from tests.retrieval.ranking_support import records_of
from tests.support import protocol, write_raster

HEIGHT_M = 100.0
SIDE_PX = 400
HALF_M = (40.0, 30.0)  # from a photo's centre to its sides on the ground
NORTH_UP = Affine(1, 0, -200, 0, -1, 200)
SETTINGS = {"tile_sizes_px": (128, 64), "overlap": 0.5, "gsd_m": "any", "gsd_tolerance": 0.1}
RULES = {"anchor_inset": 0.0, "max_range_m": 1000.0, "box_growth": 0.1}
PLANE = RULES | {"rule": "plane", "without_positive": "exclude"}


def inputs(
    folder: Path,
    centres: np.ndarray[Any, Any],
    crs: str = "EPSG:32633",
    transform: Affine = NORTH_UP,
    valid: np.ndarray[Any, Any] | None = None,
) -> SceneInputs:
    """Photos that look straight down from 100 m at a plain, x, y in metres of its CRS."""
    folder.mkdir(exist_ok=True)
    ground = np.full((1, SIDE_PX, SIDE_PX), 9, np.uint8)
    if valid is not None:
        ground[0, ~valid] = 0
    dom = write_raster(folder / "dom.tif", ground, crs=crs, transform=transform, nodata=0)
    n = len(centres)
    size = np.full(n, 80), np.full(n, 60)
    focal, middle = np.full((n, 2), 100.0), np.tile([40.0, 30.0], (n, 1))
    cameras = Cameras(*size, focal, middle, np.zeros((n, 5)))
    down = np.tile(np.diag([1.0, -1.0, -1.0]), (n, 1, 1))
    poses = Poses(rotation=down, centres=np.column_stack([centres, np.full(n, HEIGHT_M)]))
    names = tuple(f"p{i:03d}.jpg" for i in range(n))
    photos = photo_table("s", names, cameras, poses, None, 0.0)
    return SceneInputs("s", photos, crs, open_info(dom), folder / "dsm.tif", 0.0)


def built(given: SceneInputs, least: float | str = 0.0, **rules: Any) -> PreparedScene:
    gallery = MapGallery.model_validate(SETTINGS | {"least_valid_share": least})
    return build_truth(given, gallery, GeometricRules.model_validate(PLANE | rules))


def scattered(n: int = 60, seed: int = 0) -> np.ndarray[Any, Any]:
    return np.random.default_rng(seed).uniform(-150, 150, (n, 2))


IOU = {"rule": "iou", "iou_above": 0.15}


def on_meridian(folder: Path, lon: int, rules: dict[str, Any]) -> list[Any]:
    """Return what is the same on every meridian (positives, overlaps, records), and longitudes."""
    crs = f"+proj=tmerc +lat_0=40 +lon_0={lon} +ellps=WGS84 +units=m"
    found = built(inputs(folder, scattered(), crs), **rules)
    write_queries(folder / "s", found.truth.queries)
    write_truth(folder / "s", *found)
    truth = read_truth(folder / "s", "s")  # as stored
    order = np.random.default_rng(1).permuted(
        np.tile(np.arange(len(truth.tiles), dtype=np.int32), (len(truth.queries), 1)), axis=1
    )
    ranking = Ranking(order[:, :10], np.zeros(len(order), bool))
    records = records_of(truth, ranking, protocol().scores).select_dtypes("number")
    positives = [truth.positives.tiles_of(q).tolist() for q in range(len(truth.queries))]
    anchors = truth.footprints.filter(like="lon").to_numpy(float)
    lons = np.concatenate([truth.boxes[:, [0, 2]].ravel(), anchors.ravel()])
    return [positives, found.overlaps.overlap, records, lons]


@pytest.mark.parametrize("rules", [{}, IOU], ids=["plane", "iou"])
def test_the_180th_meridian_is_like_any_other(tmp_path: Path, rules: dict[str, Any]) -> None:
    # The same place on two meridians: tiles, positives, overlaps, distances and scores agree.
    here, there = (on_meridian(tmp_path / str(lon), lon, rules) for lon in (15, 180))
    assert len(here[0]) == 60
    assert there[0] == here[0]
    np.testing.assert_allclose(there[1], here[1], atol=1e-5)
    np.testing.assert_allclose(there[2], here[2], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(there[3] - 180, here[3] - 15, atol=3e-9)
    assert there[3].min() < 180 < there[3].max()


@pytest.mark.parametrize("rules", [{}, IOU], ids=["plane", "iou"])
@pytest.mark.parametrize("angle", [0, 30, 45, 135])
def test_positives_of_a_turned_map_are_those_of_the_tiles_themselves(
    tmp_path: Path, angle: int, rules: dict[str, Any]
) -> None:
    crs = "EPSG:32633"
    origin = np.array([500_000, 5_000_000])
    turned = (
        Affine.translation(*origin)
        @ Affine.rotation(angle)
        @ Affine.translation(-200, 200)
        @ Affine.scale(1, -1)
    )
    centres = scattered() + origin
    found = built(inputs(tmp_path, centres, crs, turned), without_positive="miss", **rules)
    truth = found.truth
    x, y, w, h = truth.tiles[["x", "y", "width", "height"]].to_numpy(float).T
    corners = np.stack([[x, y], [x + w, y], [x + w, y + h], [x, y + h]]).transpose(2, 0, 1)
    matrix = np.array([[turned.a, turned.b], [turned.d, turned.e]])
    tiles = shapely.polygons(corners @ matrix.T + [turned.c, turned.f])
    feet = centres[:, None] + np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * HALF_M
    if rules:
        shapes = shapely.polygons(feet)[:, None]
        common = shapely.area(shapely.intersection(shapes, tiles))
        ratio = common / (shapely.area(shapes) + shapely.area(tiles) - common)
        expected = ratio > IOU["iou_above"]
    else:
        expected = shapely.covers(tiles, shapely.points(feet)[:, :, None]).any(axis=1)
    got = np.zeros_like(expected)
    got[truth.positives.queries, truth.positives.tiles] = True
    assert 0.01 < expected.mean() < 0.3
    np.testing.assert_array_equal(got, expected)


def test_empty_tiles_are_dropped_counted_and_answer_nothing(tmp_path: Path) -> None:
    valid = np.ones((SIDE_PX, SIDE_PX), bool)
    valid[:, :200] = False
    given = inputs(tmp_path, np.array([[-150.0, 0], [100, 0]]), valid=valid)
    everything, some, many = (built(given, least).truth for least in ("none", 0.0, 0.6))
    empty = everything.tiles["valid_share"] == 0
    assert empty.sum() > 20
    assert some.tiles["id"].tolist() == everything.tiles["id"][~empty].tolist()
    assert some.dropped_tiles["id"].tolist() == everything.tiles["id"][empty].tolist()
    assert (many.tiles["valid_share"] >= 0.6).all()
    assert len(many.tiles) + len(many.dropped_tiles) == len(everything.tiles)
    assert everything.queries["id"].tolist() == ["s/p000", "s/p001"]
    assert some.queries["id"].tolist() == ["s/p001"]
    assert "valid pixels" in some.excluded["reason"].item()


def test_the_reason_that_is_given_is_the_true_one(tmp_path: Path) -> None:
    # From 100 m a photo sees 80 x 60 m; the first one here sees all of a map of 40 m.
    small = Affine(0.1, 0, -20, 0, -0.1, 20)
    given = inputs(tmp_path, np.array([[0.0, 0], [38, 28], [500, 0]]), transform=small)
    excluded = built(given).truth.excluded
    assert excluded.set_index("id")["reason"].to_dict() == {
        "s/p000": "the footprint overlaps tiles, but none of its 4 points lies in one",
        "s/p002": "the footprint meets no tile",
    }
    given = inputs(tmp_path, np.array([[5000.0, 0]]))
    write_queries(tmp_path / "s", given.photos)
    write_truth(tmp_path / "s", *built(given))
    with pytest.raises(BenchmarkError, match="scene s has no query: 1 photo excluded"):
        read_truth(tmp_path / "s", "s")
