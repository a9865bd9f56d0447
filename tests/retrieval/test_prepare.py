"""The truth of a scene: how its map is cut, and which tile answers which photo."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import shapely
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer
from rasterio import Affine

from airzoo_bench.benchmark.queries import SceneInputs, photo_table, write_queries
from airzoo_bench.core.errors import BenchmarkError, RasterError
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.retrieval.prepare import build_truth, cut_gallery, tile_starts
from airzoo_bench.retrieval.settings import GeometricRules, MapGallery
from airzoo_bench.retrieval.truth import BOX_COLUMNS, RetrievalTruth, read_truth, write_truth
from tests.support import write_raster

UTM = {"crs": "EPSG:32650", "transform": Affine(0.5, 0, 500_000, 0, -0.5, 3_000_000)}
BLANK = np.zeros((1, 100, 150), np.uint8)


def gallery(*sizes: int, gsd_m: float | str = "any", least: float | str = 0.0) -> MapGallery:
    rules = {"overlap": 0.5, "gsd_tolerance": 0.1, "least_valid_share": least, "gsd_m": gsd_m}
    return MapGallery.model_validate(rules | {"tile_sizes_px": sizes})


@pytest.mark.parametrize(
    ("length", "starts"),
    [
        # 150 px, tiles of 64 at stride 32: 0, 32, 64 (ends at 128); the next would end at 160, so
        # the last one is anchored at 150 - 64 = 86. 128 px is met exactly.
        (150, [0, 32, 64, 86]),
        (128, [0, 32, 64]),
        (64, [0]),
        (40, [0]),
    ],
)
def test_starts_worked_by_hand(length: int, starts: list[int]) -> None:
    assert tile_starts(length, 64, 0.5).tolist() == starts


@given(
    length=st.integers(1, 5000), size=st.integers(16, 1500), overlap=st.sampled_from([0, 0.25, 0.5])
)
def test_tiles_cover_the_axis_and_stay_on_it(length: int, size: int, overlap: float) -> None:
    starts = tile_starts(length, size, overlap)
    assert starts[0] == 0
    assert (np.diff(starts) > 0).all()
    stride = max(1, (Fraction(size) * (1 - Fraction(overlap)) + Fraction(1, 2)).__floor__())
    assert (np.diff(starts)[:-1] == stride).all()
    assert (np.diff(starts)[-1:] <= stride).all()
    assert starts[-1] + min(size, length) == length


def test_a_projected_map(tmp_path: Path) -> None:
    # UTM 50N, 0.5 m pixels. The box of a tile holds its corners and is no larger than they ask.
    path = write_raster(tmp_path / "m.tif", BLANK, **UTM)
    tiles = cut_gallery(open_info(path), gallery(64, 32), "s")
    assert len(tiles) == 4 * 3 + 9 * 6
    assert tiles["id"].is_monotonic_increasing
    tile = tiles.set_index("id").loc["s/64_00002_00003"]
    # Row 2 begins at 100 - 64 = 36, column 3 at 86 px: 43 m east and 18 m south of the corner.
    assert (tile["x"], tile["y"]) == (86, 36)
    to_lonlat = Transformer.from_crs("EPSG:32650", "EPSG:4326", always_xy=True)
    xs, ys = np.array([43.0, 75.0]) + 500_000, 3_000_000 - np.array([18.0, 50.0])
    lon, lat = to_lonlat.transform(*np.meshgrid(xs, ys))
    expected = [lon.min(), lat.min(), lon.max(), lat.max()]
    np.testing.assert_allclose(tile[list(BOX_COLUMNS)].to_numpy(float), expected, atol=1e-9)
    # Off the central meridian's true scale by 0.04 %.
    assert tile["size_m"] == pytest.approx(32 / 0.9996, abs=2e-3)


def test_pixels_are_measured_on_the_ground_and_the_earth_ends(tmp_path: Path) -> None:
    # At 60 degrees north a web mercator metre is half a metre.
    y = Transformer.from_crs("EPSG:4326", "EPSG:3857", always_xy=True).transform(10, 60)[1]
    place = {"crs": "EPSG:3857", "transform": Affine(0.6, 0, 1_000_000, 0, -0.6, y)}
    info = open_info(write_raster(tmp_path / "m.tif", BLANK, **place))
    assert len(cut_gallery(info, gallery(64, 32, gsd_m=0.3), "s")) == 66
    with pytest.raises(RasterError, match=r"0\.300"):
        cut_gallery(info, gallery(64, gsd_m=0.6), "s")
    place = {"crs": "EPSG:4326", "transform": Affine(0.1, 0, 10, 0, -0.1, -84)}
    with pytest.raises(RasterError, match="not on the earth"):
        cut_gallery(open_info(write_raster(tmp_path / "n.tif", BLANK, **place)), gallery(64), "s")


@pytest.mark.parametrize("how", ["nodata", "alpha", "mask"])
def test_shares_of_valid_pixels_are_counted_exactly(tmp_path: Path, how: str) -> None:
    valid = np.random.default_rng(0).random((100, 150)) < 0.3
    valid[:40, :70] = False
    bands = np.repeat(np.where(valid, 200, 0).astype(np.uint8)[None], 3 + (how == "alpha"), axis=0)
    path = write_raster(tmp_path / "m.tif", bands, **UTM, nodata=0 if how == "nodata" else None)
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(path, "r+") as raster:
        if how == "alpha":
            raster.colorinterp = [*raster.colorinterp[:3], rasterio.enums.ColorInterp.alpha]
        if how == "mask":
            raster.write_mask(valid)
    tiles = cut_gallery(open_info(path), gallery(64, 32), "s")
    windows = tiles[["x", "y", "width", "height"]].to_numpy()
    expected = [valid[y : y + h, x : x + w].mean() for x, y, w, h in windows]
    np.testing.assert_array_equal(tiles["valid_share"], expected)
    assert (tiles["valid_share"] == 0).sum() == 3


# --- positives of photos that look straight down on a plain ---

SIDE_PX = 400
HALF_M = (40.0, 30.0)  # from a photo's centre to its sides on the ground
NORTH_UP = Affine(1, 0, -200, 0, -1, 200)
PLANE = {"anchor_inset": 0.0, "max_range_m": 1000.0, "box_growth": 0.1}
PLANE |= {"rule": "plane", "without_positive": "exclude"}
IOU = {"rule": "iou", "iou_above": 0.15}


def inputs(
    folder: Path,
    centres: np.ndarray[Any, Any],
    crs: str = "EPSG:32633",
    transform: Affine = NORTH_UP,
    valid: np.ndarray[Any, Any] | None = None,
) -> SceneInputs:
    """Photos from 100 m, x, y in metres of the CRS."""
    folder.mkdir(exist_ok=True)
    ground = np.full((1, SIDE_PX, SIDE_PX), 9, np.uint8)
    if valid is not None:
        ground[0, ~valid] = 0
    dom = write_raster(folder / "dom.tif", ground, crs=crs, transform=transform, nodata=0)
    n = len(centres)
    size, middle = (np.full(n, 80), np.full(n, 60)), np.tile([40.0, 30.0], (n, 1))
    cameras = Cameras(*size, np.full((n, 2), 100.0), middle, np.zeros((n, 5)))
    down = np.tile(np.diag([1.0, -1.0, -1.0]), (n, 1, 1))
    poses = Poses(rotation=down, centres=np.column_stack([centres, np.full(n, 100.0)]))
    photos = photo_table("s", [f"p{i:03d}.jpg" for i in range(n)], cameras, poses, None, 0.0)
    return SceneInputs("s", photos, crs, open_info(dom), folder / "dsm.tif", 0.0)


def built(given: SceneInputs, least: float | str = 0.0, **rules: Any) -> RetrievalTruth:
    chosen = GeometricRules.model_validate(PLANE | rules)
    return build_truth(given, gallery(128, 64, least=least), chosen)


def scattered() -> np.ndarray[Any, Any]:
    return np.random.default_rng(0).uniform(-150, 150, (60, 2))


@pytest.mark.parametrize("rules", [{}, IOU], ids=["plane", "iou"])
def test_the_180th_meridian_is_like_any_other(tmp_path: Path, rules: dict[str, Any]) -> None:
    # The same place on two meridians, as stored.
    found = []
    for lon in (15, 180):
        crs = f"+proj=tmerc +lat_0=40 +lon_0={lon} +ellps=WGS84 +units=m"
        scene = built(inputs(tmp_path / str(lon), scattered(), crs), **rules)
        write_queries(tmp_path / str(lon), scene.queries)
        write_truth(tmp_path / str(lon), scene)
        truth = read_truth(tmp_path / str(lon), "s")
        places = [
            truth.tiles[["lon_min", "lon_max"]].to_numpy(),
            truth.footprints.filter(like="lon").to_numpy(float),
        ]
        lons = np.concatenate([one.ravel() for one in places])
        found.append((truth.positives, scene.overlaps, truth.tiles["size_m"], lons))
    here, there = found
    assert len(here[0].counts) == 60
    for one, other in zip(here[0:2], there[0:2], strict=True):
        assert np.array_equal(one.offsets, other.offsets)
        assert np.array_equal(one.tiles, other.tiles)
    np.testing.assert_allclose(there[1].overlap, here[1].overlap, atol=1e-5)
    np.testing.assert_allclose(there[2], here[2], rtol=1e-5)
    np.testing.assert_allclose(there[3] - 180, here[3] - 15, atol=3e-9)
    assert there[3].min() < 180 < there[3].max()


@pytest.mark.parametrize("rules", [{}, IOU], ids=["plane", "iou"])
@pytest.mark.parametrize("angle", [0, 30, 135])
def test_positives_of_a_turned_map_are_those_of_the_tiles_themselves(
    tmp_path: Path, angle: int, rules: dict[str, Any]
) -> None:
    origin = np.array([500_000, 5_000_000])
    turned = Affine.translation(*origin) @ Affine.rotation(angle)
    turned = turned @ Affine.translation(-200, 200) @ Affine.scale(1, -1)
    centres = scattered() + origin
    given = inputs(tmp_path, centres, "EPSG:32633", turned)
    truth = built(given, without_positive="miss", **rules)
    assert set(truth.tiles["size_m"].round()) == {64, 128}  # of the tiles, not of their boxes
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
    everything, some, many = (built(given, least) for least in ("none", 0.0, 0.6))
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
    excluded = built(given).excluded.set_index("id")["reason"]
    assert excluded.index.tolist() == ["s/p000", "s/p002"]
    assert "overlaps tiles" in excluded["s/p000"]
    assert excluded["s/p002"] == "the footprint meets no tile"
    given = inputs(tmp_path, np.array([[5000.0, 0]]))
    write_queries(tmp_path / "s", given.photos)
    write_truth(tmp_path / "s", built(given))
    with pytest.raises(BenchmarkError, match="scene s has no query: 1 photo excluded"):
        read_truth(tmp_path / "s", "s")
