from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from pyproj import CRS, Transformer
from rasterio import Affine

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.rasters import RasterInfo, pixel_to_world, world_to_pixel
from airzoo_bench.matching import lifting
from airzoo_bench.matching.lifting import LiftStatus, lift
from tests.geometry.support import quick, seeds, write_tif

NAN = np.nan
ORIGIN = (576000.0, 5188000.0)


GRID = Affine(0.5, 0.0, ORIGIN[0], 0.0, -0.5, ORIGIN[1])


def map_of(width: int, height: int, grid: Affine = GRID, crs: int = 32615) -> RasterInfo:
    known = CRS.from_user_input(crs)
    return RasterInfo(Path("dom.tif"), width, height, grid, known, None, 3, "uint8")


def random_dsm(rng: np.random.Generator, path: Path) -> tuple[np.ndarray, Affine]:
    """Write a small surface model with holes; return heights (NaN: none) and its geotransform."""
    heights = rng.uniform(-60, 90, rng.integers(1, 14, 2)).astype(np.float32)
    lost = rng.random(heights.shape) < rng.choice([0.0, 0.3, 0.8])
    nodata = rng.choice([-9999.0, NAN, None])
    stored = np.where(lost, np.float32(NAN if nodata is None else nodata), heights)
    gsd = rng.uniform(0.2, 1.5)
    x, y = ORIGIN + rng.uniform(-2, 2, 2)
    transform = Affine(gsd, 0.0, x, 0.0, -gsd * rng.uniform(0.8, 1.2), y)
    write_tif(path, stored, nodata=nodata, transform=transform)
    return np.where(lost, NAN, heights), transform


@quick
@given(seeds)
def test_points_are_those_of_the_height_field(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    path = tmp_path_factory.mktemp("lift") / "dsm.tif"
    heights, grid = random_dsm(rng, path)
    dom = map_of(20, 17)
    xy = rng.uniform(-1, 21, (80, 2))
    xy[40:] = rng.integers(0, 69, (40, 2)) / 4  # on lines between centres, on centres, borders
    xy[:3] = (NAN, 1.0), (3.0, np.inf), (1e308, -1e308)
    lifted = lift(xy, dom, path, jobs=2)
    on_map = ((xy >= 0) & (xy <= (20, 17))).all(axis=1)
    world = pixel_to_world(dom.transform, np.where(on_map[:, None], xy, NAN))
    colrow = world_to_pixel(grid, world)
    on_dsm = ((colrow >= 0) & (colrow <= heights.shape[::-1])).all(axis=1)
    z = HeightField.read(path).sample(world)
    status = np.where(np.isnan(z), LiftStatus.NO_HEIGHT, LiftStatus.LIFTED)
    status[~on_dsm] = LiftStatus.OUTSIDE_DSM
    status[~on_map] = LiftStatus.OUTSIDE_MAP
    assert lifted.status.tolist() == status.tolist()
    is_lifted = (lifted.status == LiftStatus.LIFTED)[:, None]
    expected = np.where(is_lifted, np.column_stack((world, z)), NAN)
    assert lifted.points.tobytes() == expected.tobytes()


def test_pixel_centres_sit_at_one_half(tmp_path: Path) -> None:
    path = write_tif(tmp_path / "dsm.tif", np.array([[0, 10], [20, 30]], np.float32))
    xy = [(0.5, 0.5), (1.5, 0.5), (0.5, 1.5), (1.0, 1.0), (0.75, 0.5), (0.0, 0.0), (2.0, 2.0)]
    lifted = lift(xy, map_of(2, 2), path, jobs=1)
    assert lifted.points[:, 2].tolist() == [0, 10, 20, 15, 2.5, 0, 30]
    assert lifted.points[0].tolist() == [576000.25, 5187999.75, 0.0]


def test_map_in_degrees(tmp_path: Path) -> None:
    column, row = np.meshgrid(np.arange(90) + 0.5, np.arange(80) + 0.5)
    plane = (0.25 * column - 0.125 * row).astype(np.float32)
    path = write_tif(tmp_path / "dsm.tif", plane)
    to_utm = Transformer.from_crs(4326, 32615, always_xy=True)
    west, north = to_utm.transform(ORIGIN[0] + 5, ORIGIN[1] - 5, direction="INVERSE")
    dom = map_of(60, 50, Affine(4e-6, 0.0, west, 0.0, -3e-6, north), 4326)
    xy = np.random.default_rng(0).uniform((0, 0), (60, 50), (200, 2))
    lifted = lift(xy, dom, path, jobs=2)
    x, y = to_utm.transform(west + 4e-6 * xy[:, 0], north - 3e-6 * xy[:, 1])
    z = 0.25 * (x - ORIGIN[0]) / 0.5 - 0.125 * (ORIGIN[1] - y) / 0.5
    assert lifted.status.max() == LiftStatus.LIFTED
    np.testing.assert_allclose(lifted.points, np.stack((x, y, z), axis=-1), rtol=0, atol=1e-5)
    # At the end of the projection's domain there is no place.
    far = map_of(10, 10, Affine(1.0, 0.0, 0.0, 0.0, -1.0, 90.0), 4326)
    assert lift([(5.0, 5.0)], far, path, jobs=1).status.tolist() == [LiftStatus.OUTSIDE_DSM]


def test_blocks_threads_and_order_do_not_matter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng, tiles = np.random.default_rng(3), {"tiled": True, "blockxsize": 32, "blockysize": 16}
    heights = rng.normal(0, 20, (60, 90)).astype(np.float32)
    heights[rng.random(heights.shape) < 0.2] = -9999
    path = write_tif(tmp_path / "dsm.tif", heights, nodata=-9999, **tiles)
    dom, xy = map_of(90, 60), rng.uniform((-3, -3), (93, 63), (1000, 2))
    whole, order = lift(xy, dom, path, jobs=1), rng.permutation(len(xy))
    assert {0, 1, 2} <= {*np.unique(whole.status, return_inverse=True)[1].tolist()}
    for pixels, points, jobs in ((1000, 77, 1), (256, 5000, 3), (1, 64, 2)):
        monkeypatch.setattr(lifting, "_BLOCK_PIXELS", pixels)
        monkeypatch.setattr(lifting, "_POINTS", points)
        again = lift(xy[order], dom, path, jobs=jobs)
        assert again.points.tobytes() == whole.points[order].tobytes()
        assert again.status.tobytes() == whole.status[order].tobytes()


def test_a_truncated_file_is_named(tmp_path: Path) -> None:
    heights = np.random.default_rng(0).normal(size=(90, 90)).astype(np.float32)
    path = write_tif(tmp_path / "d.tif", heights)
    path.write_bytes(path.read_bytes()[:20_000])
    with pytest.raises(RasterError, match=r"d\.tif"):
        lift(np.argwhere(heights < 9.0), map_of(90, 90), path, jobs=2)


def test_no_matches(tmp_path: Path) -> None:
    path = write_tif(tmp_path / "dsm.tif", np.zeros((4, 4), np.float32))
    assert lift(np.empty((0, 2)), map_of(4, 4), path, jobs=2).points.shape == (0, 3)
