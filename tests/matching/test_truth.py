"""The truth: which photos are queries, where their crops lie, and the lift of pixels to points."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import rasterio
from hypothesis import given
from pyproj import CRS, Transformer
from rasterio import Affine

from airzoo_bench.benchmark.queries import POSE_COLUMNS, PRIOR_COLUMNS, SceneInputs, poses_of
from airzoo_bench.core.errors import BenchmarkError, RasterError
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import (
    Poses,
    angles_to_rotations,
    matrix_to_quaternion,
    rotations_to_angles,
)
from airzoo_bench.geometry.rasters import RasterInfo, open_info, pixel_to_world, world_to_pixel
from airzoo_bench.matching import solving
from airzoo_bench.matching.protocol import Crop, Prior
from airzoo_bench.matching.solving import LiftStatus, lift
from airzoo_bench.matching.truth import (
    CropStatus,
    MatchingTruth,
    build_truth,
    crop_windows,
    write_crop,
)
from tests.geometry.support import looking_down, quick, seeds, write_tif
from tests.matching.world import SCENE, World
from tests.support import PLACE_CRS

NAN = np.nan
X, Y = 576000.0, 5188000.0
# 2 m pixels; the map's corner lies 500 m west and 1000 m north of (X, Y).
GRID = Affine(2.0, 0.0, X - 500, 0.0, -2.0, Y + 1000)
METADATA, TRUTH = Prior(source="metadata"), Prior(source="truth")


def rule(margin: float, far: float) -> Crop:
    return Crop(margin=margin, max_range_m=far, missing_heights="nearest", nearest_of_px=10_000)


def map_of(width: int, height: int, grid: Affine = GRID, crs: int = 32615) -> RasterInfo:
    return RasterInfo(Path("dom.tif"), width, height, grid, CRS(crs), None, 3, "uint8")


def ground(heights: Any, step: float = 20.0) -> HeightField:
    """Ground about (X, Y) whose pixels are `step` wide."""
    rows, columns = np.shape(heights)
    grid = Affine(step, 0.0, X - columns * step / 2, 0.0, -step, Y + rows * step / 2)
    return HeightField(np.array(heights, float), grid, "EPSG:32615")


LEVEL = ground(np.zeros((200, 200)))


def camera(f: float, distortion: Any = None) -> Cameras:
    """A camera of 600 x 400 pixels."""
    return Cameras.from_matrices([[[f, 0, 300], [0, f, 200], [0, 0, 1]]], 600, 400, distortion)


def cut(
    field: HeightField, crop: Crop, at: Any = (X, Y, 100.0), tilt: float = 0.0, f: float = 600.0
) -> tuple[int, ...]:
    """The crop of one photo on a map of 1000 m by 2000 m; rays are along (+-3, +-2, -6) / 7."""
    pose = Poses.from_centres(looking_down(tilt), [at])
    windows, _ = crop_windows(camera(f), pose, map_of(500, 1000), field, crop)
    return tuple(windows[0].tolist())


# 100 m up, 600 x 400 px at f = 1000: 60 m by 40 m about (X + 10, Y - 20). The west side is at
# X - 20, 480 m = 240 px from the map's corner; the north side at Y, 1000 m from it.
NADIR: dict[str, Any] = {"at": (X + 10, Y - 20, 100.0), "f": 1000.0}
ASIDE = NADIR | {"at": (X + 10.25, Y - 20, 100.0)}
HIGH, NOWHERE = ground(np.full((200, 200), 50.0)), ground(np.full((9, 9), NAN), 250.0)
# 45 degrees down to the north, corners at x/z = 1/2, y/z = 1/3; 100 m up. The far corners lie
# 100 (1 + 1/3) / (1 - 1/3) = 200 m north, the near ones 50 m; the far side is 150 sqrt(2) m.
HALF, GROWN = 75 * np.sqrt(2), 15 * np.sqrt(2)
LEFT, RIGHT = np.floor((500 - HALF - GROWN) / 2), np.ceil((500 + HALF + GROWN) / 2)
TOP, BOTTOM = np.floor((1000 - 200 - 15) / 2), np.ceil((1000 - 50 + 15) / 2)
TILTED = (LEFT, TOP, RIGHT - LEFT, BOTTOM - TOP)
# Ground at 40 m with a lake of 200 m about (X, Y), which meets the nearest height.
LAKE = np.full((200, 200), 40.0)
LAKE[75:125, 75:125] = NAN
BY_HAND: dict[str, tuple[HeightField, Crop, dict[str, Any], tuple[float, ...]]] = {
    "nadir": (LEVEL, rule(0.0, 300.0), NADIR, (240, 500, 30, 20)),
    "a tenth of 30 and 20 px more": (LEVEL, rule(0.1, 300.0), NADIR, (237, 498, 36, 24)),
    "outward to whole pixels": (LEVEL, rule(0.0, 300.0), ASIDE, (240, 500, 31, 20)),
    # The DSM counts: half as large.
    "on ground 50 m high": (HIGH, rule(0.0, 300.0), NADIR, (247, 505, 16, 10)),
    "tilted": (LEVEL, rule(0.1, 500.0), {"tilt": 45.0}, TILTED),
    # Level to the north: corners along (+-3, 6, +-2) / 7. The upper ones never come down: 700 m
    # out they are 300 m aside and 600 m north. The lower ones land after 350 m, half as far.
    "over the horizon": (LEVEL, rule(0.0, 700.0), {"tilt": 90.0}, (100, 200, 300, 150)),
    # All are cut: 75 m aside, 150 m north; a box without height still has a pixel.
    "before the ground": (LEVEL, rule(0.0, 175.0), {"tilt": 90.0}, (212, 425, 76, 1)),
    "a hole": (ground(LAKE, 4.0), rule(0.0, 700.0), {}, (235, 490, 30, 20)),
    "no height": (NOWHERE, rule(0.0, 350.0), {}, (175, 450, 150, 100)),
}


@pytest.mark.parametrize("case", BY_HAND)
def test_crops_by_hand(case: str) -> None:
    field, crop, given, expected = BY_HAND[case]
    assert cut(field, crop, **given) == expected


def test_cut_to_the_map_and_off_it_and_without_a_ray() -> None:
    at = [(X - 490, Y + 995, 100.0), (X - 531, Y, 100.0), (X + 490, Y - 190, 100.0), (X, Y, 100.0)]
    poses = Poses.from_centres(np.tile(looking_down(0), (4, 1, 1)), at)
    K = np.tile(camera(1000).matrices, (4, 1, 1))
    lens = np.zeros((4, 4))
    lens[3, 0] = -9.0  # a barrel that folds back before the corners
    cameras = Cameras.from_matrices(K, 600, 400, lens)
    crop = rule(0.0, 300.0)
    windows, status = crop_windows(cameras, poses, map_of(500, 600), LEVEL, crop)
    assert windows.tolist() == [[0, 0, 20, 13], [0] * 4, [480, 585, 20, 15], [0] * 4]
    cropped = CropStatus.CROPPED
    assert status.tolist() == [cropped, CropStatus.OFF_MAP, cropped, CropStatus.NO_RAY]


# --- which photos are queries -------------------------------------------------------------------


@pytest.fixture(scope="module")
def inputs(world: World) -> SceneInputs:
    dom, dsm = (world.root.parent / "sources" / name for name in ("dom.tif", "dsm.tif"))
    return SceneInputs(SCENE, world.truth.queries, PLACE_CRS, open_info(dom), dsm, 100.0)


def built(inputs: SceneInputs, photos: pd.DataFrame, prior: Prior = METADATA) -> MatchingTruth:
    return build_truth(replace(inputs, photos=photos), rule(0.1, 500.0), prior)


def test_photos_without_a_crop_are_left_out_with_the_reason(inputs: SceneInputs) -> None:
    photos = inputs.photos.copy()
    photos.loc[photos.index[0], "prior_qz"] = NAN
    photos.loc[photos.index[4], "prior_x"] += 20_000
    truth = built(inputs, photos)
    assert truth.queries["id"].tolist() == ["hills/q1", "hills/q2", "hills/q3"]
    np.testing.assert_array_equal(truth.crops, built(inputs, inputs.photos).crops[1:4])
    assert truth.excluded["image"].tolist() == ["q0.png", "q4.png"]
    assert truth.excluded["reason"].tolist() == [CropStatus.NO_PRIOR, CropStatus.OFF_MAP]


@pytest.mark.parametrize("moved", [0, 2])
def test_a_prior_that_is_the_truth_through_xmp_is_refused(inputs: SceneInputs, moved: int) -> None:
    # As an exporter writes it: metres to the millimetre, angles to a tenth of a degree.
    # Moving less than half of the photos away hides nothing.
    photos = inputs.photos.copy()
    poses = poses_of(photos)
    angles = np.round(rotations_to_angles(poses.rotation, convergence_deg=0.0), 1)
    turned = angles_to_rotations(*angles.T, convergence_deg=0.0)
    photos[list(PRIOR_COLUMNS[:4])] = matrix_to_quaternion(turned)
    photos[list(PRIOR_COLUMNS[4:])] = np.round(poses.centres, 3)
    photos.loc[photos.index[:moved], "prior_x"] += 30.0
    with pytest.raises(BenchmarkError, match=f"truth in {5 - moved} of 5 photos"):
        built(inputs, photos)


def test_truth_as_prior_by_name(inputs: SceneInputs) -> None:
    truth = built(inputs, inputs.photos.drop(columns=list(PRIOR_COLUMNS)), TRUTH)
    np.testing.assert_array_equal(truth.priors.centres, truth.poses.centres)


def test_written_crops(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    grid = {"transform": Affine(0.3, 0, X, 0, -0.3, Y), "photometric": "RGB", "alpha": "YES"}
    dom = write_tif(tmp_path / "dom.tif", rng.integers(0, 255, (4, 60, 80), np.uint8), **grid)
    heights = rng.normal(0, 9, (50, 70)).astype(np.float32)
    heights[rng.random(heights.shape) < 0.2] = -9999
    below = Affine(0.5, 0, X - 3.1, 0, -0.5, Y + 1.7)
    dsm = write_tif(tmp_path / "dsm.tif", heights, nodata=-9999, transform=below)
    written = write_crop(dom, dsm, (11, 7, 40, 30), tmp_path / "crops", "photo")
    with rasterio.open(dom) as whole, rasterio.open(written[0]) as crop:
        assert np.array_equal(crop.read(), whole.read()[:, 7:37, 11:51])
        assert crop.colorinterp == whole.colorinterp
    # The surface inside the crop is that of the whole, gaps and all, to the crop's very border.
    xy = rng.uniform((0, 0), (40, 30), (3000, 2))
    xy[:4] = (0, 0), (40, 0), (0, 30), (40, 30)
    everywhere = lift(np.add(xy, (11, 7)), open_info(dom), dsm, jobs=1)
    part = lift(xy, open_info(written[0]), written[1], jobs=1)
    np.testing.assert_allclose(part.points, everywhere.points, rtol=0, atol=1e-6)
    assert (everywhere.status == LiftStatus.NO_HEIGHT).any()
    afar = write_tif(tmp_path / "afar.tif", heights[:9, :9], transform=GRID)
    with pytest.raises(RasterError, match="does not meet"):
        write_crop(dom, afar, (0, 0, 5, 5), tmp_path / "none", "photo")


def test_fingerprint_sees_all_that_scores_depend_on(world: World) -> None:
    truth, known = world.truth, world.truth.maps[0]
    others = []
    for column in ("id", "width", "fx", "cy", "k1", "p2", *POSE_COLUMNS[1:]):
        queries = truth.queries.copy()
        queries.loc[1, column] += {"id": "x", "width": 1}.get(column, 1e-6)
        others.append(replace(truth, queries=queries))
    others.append(replace(truth, crops=truth.crops + np.eye(5, 4, dtype=int)))
    shifted = known.dom.transform @ Affine.translation(0.5, 0.5)
    others += [
        replace(truth, maps=(replace(known, dsm_sha256="0" * 64),)),
        replace(truth, maps=(replace(known, dom=replace(known.dom, transform=shifted)),)),
        replace(truth, maps=(replace(known, dom=replace(known.dom, width=known.dom.width + 1)),)),
    ]
    prints = {truth.fingerprint, *(other.fingerprint for other in others)}
    assert len(prints) == 1 + len(others) == 17


# --- the lift ---


ORIGIN = (X, Y)
HALF_METRE = Affine(0.5, 0.0, ORIGIN[0], 0.0, -0.5, ORIGIN[1])


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
    dom = map_of(20, 17, HALF_METRE)
    xy = rng.uniform(-1, 21, (80, 2))
    xy[40:] = rng.integers(0, 69, (40, 2)) / 4  # on lines between centres, on centres, borders
    xy[:3] = (NAN, 1.0), (3.0, np.inf), (1e308, -1e308)
    least = rng.choice([None, -60.0, 0.0])
    lifted = lift(xy, dom, path, heights_above_m=least, jobs=2)
    on_map = ((xy >= 0) & (xy <= (20, 17))).all(axis=1)
    world = pixel_to_world(dom.transform, np.where(on_map[:, None], xy, NAN))
    colrow = world_to_pixel(grid, world)
    on_dsm = ((colrow >= 0) & (colrow <= heights.shape[::-1])).all(axis=1)
    z = HeightField.read(path).sample(world)
    if least is not None:  # holes, and heights of 0 for none: all neighbours must be heights
        ends = np.floor(colrow - 0.5), np.ceil(colrow - 0.5)
        last = np.array(heights.shape[::-1]) - 1
        near = [np.clip(np.nan_to_num(end), 0, last).astype(int) for end in ends]
        for (column, _), (_, row) in product([one.T for one in near], repeat=2):
            z[~(heights[row, column] > least)] = NAN
    status = np.where(np.isnan(z), LiftStatus.NO_HEIGHT, LiftStatus.LIFTED)
    status[~on_dsm] = LiftStatus.OUTSIDE_DSM
    status[~on_map] = LiftStatus.OUTSIDE_MAP
    assert lifted.status.tolist() == status.tolist()
    is_lifted = (lifted.status == LiftStatus.LIFTED)[:, None]
    expected = np.where(is_lifted, np.column_stack((world, z)), NAN)
    assert lifted.points.tobytes() == expected.tobytes()


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
    dom, xy = map_of(90, 60, HALF_METRE), rng.uniform((-3, -3), (93, 63), (1000, 2))
    whole, order = lift(xy, dom, path, jobs=1), rng.permutation(len(xy))
    assert len(np.unique(whole.status)) > 2
    assert lift(np.empty((0, 2)), dom, path, jobs=2).points.shape == (0, 3)
    for pixels, points, jobs in ((1000, 77, 1), (256, 5000, 3), (1, 64, 2)):
        monkeypatch.setattr(solving, "_BLOCK_PIXELS", pixels)
        monkeypatch.setattr(solving, "_CHUNK", points)
        monkeypatch.setattr(solving, "_POINTS", points)
        again = lift(xy[order], dom, path, jobs=jobs)
        assert again.points.tobytes() == whole.points[order].tobytes()
        assert again.status.tobytes() == whole.status[order].tobytes()
