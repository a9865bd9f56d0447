"""Changes that make a sound place suspect."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from PIL import Image
from rasterio import Affine

from tests.datasets.tagged import LEVEL, NAMES, tag
from tests.support import MAP_SIZE_M, NORTH_WEST, Place, write_raster


def moved(place: Place) -> None:
    for name, (x, y) in place.centres.items():
        place.change_image(name, center=[NORTH_WEST[0] + x + 40, NORTH_WEST[1] - y, 200.0])


def lowered(place: Place) -> None:
    write_raster(place.dsm, LEVEL - 27.5)


def in_feet(place: Place) -> None:
    # 20 m are 65.6 ft: the cameras, at 200 m, still are above them.
    write_raster(place.dsm, LEVEL / 5 / 0.3048)
    for name in NAMES:
        tag(place, name, relative=180.0)


def retag(names: tuple[str, ...], **changes: Any) -> Callable[[Place], None]:
    return lambda place: [tag(place, name, **changes) for name in names] and None


def hole(place: Place) -> None:
    heights = LEVEL.copy()
    heights[0, 2:4, 3] = 0.0
    write_raster(place.dsm, heights)


def zeros(place: Place) -> None:
    heights = LEVEL.copy()
    heights[0, :20] = 0.0
    write_raster(place.dsm, heights)


def shifted(place: Place) -> None:
    grid = Affine(1, 0, NORTH_WEST[0] + 30, 0, -1, NORTH_WEST[1])
    write_raster(place.dom, np.full((3, MAP_SIZE_M, MAP_SIZE_M), 9, np.uint8), transform=grid)


def shifted_holes(place: Place) -> None:
    rng = np.random.default_rng(1)
    holes = np.kron(rng.random((32, 32)) < 0.3, np.ones((8, 8), bool))
    ground = np.where(holes, 0, 90).astype(np.uint8)
    write_raster(place.dsm, np.where(holes, -9999, LEVEL).astype(np.float32), nodata=-9999)
    grid = Affine(1, 0, NORTH_WEST[0] + 9, 0, -1, NORTH_WEST[1] + 6)
    write_raster(place.dom, np.stack([ground[:250]] * 3), transform=grid)


def high_cloud(place: Place) -> dict[str, object]:
    xy = np.random.default_rng(0).uniform(10, 240, (500, 2)) * (1, -1) + NORTH_WEST
    cloud = place.dsm.with_name("cloud.npy")
    np.save(cloud, np.column_stack((xy, np.full(500, 127.5))))
    return {"cloud": cloud}


def small_map(place: Place) -> None:
    dom = np.full((3, 88, 100), 9, np.uint8)
    grid = Affine(1, 0, NORTH_WEST[0] + 10, 0, -1, NORTH_WEST[1] - 20)
    write_raster(place.dom, dom, transform=grid)


def coarse(place: Place) -> None:
    grid = Affine(8, 0, NORTH_WEST[0], 0, -8, NORTH_WEST[1])
    write_raster(place.dom, np.full((3, 32, 32), 9, np.uint8), transform=grid)


def copied(place: Place) -> None:
    for name in NAMES[1:3]:
        (place.images / name).write_bytes((place.images / NAMES[0]).read_bytes())


def two_cameras(place: Place) -> None:
    for name in NAMES:
        tag(place, name, camera="FC300S" if name < "c" else "FC6310")


def two_flights(place: Place) -> None:
    for name in NAMES:
        tag(place, name, camera="FC300S", day="2016:06:23" if name < "c" else "2019:07:01")


def same_pose(place: Place) -> None:
    place.change_image("a.jpg", center=place.read_poses()["images"]["b.jpg"]["center"])


def no_metadata(place: Place) -> None:
    Image.new("L", (64, 48), 7).save(place.images / "a.jpg")


def in_float32(place: Place) -> None:
    for number, (name, image) in enumerate(place.read_poses()["images"].items()):
        x, y, z = (float(np.float32(value + 0.28 + 0.4 * number)) for value in image["center"])
        place.change_image(name, center=[x, y, z])


def in_one_line(place: Place) -> dict[str, object]:
    for name in NAMES:
        x, y = place.centres["a.jpg" if name < "c" else "b.jpg"]
        place.change_image(name, center=[NORTH_WEST[0] + x, NORTH_WEST[1] - y, 200.0])
    return high_cloud(place)


def one_height(place: Place) -> None:
    # One of more than a million pixels: the nearest height is looked for among every second one.
    heights = np.full((1, 1100, 1100), np.nan, np.float32)
    heights[0, 100, 102], heights[0, 102, 106] = 100.0, 99.5
    write_raster(place.dsm, heights)


def tower(place: Place) -> None:
    heights = LEVEL.copy()
    heights[0, 54:74, 54:74] = 300.0
    write_raster(place.dsm, heights)


def cloud_beside(place: Place) -> dict[str, object]:
    xy = np.random.default_rng(0).uniform(300, 400, (500, 2)) * (1, -1) + NORTH_WEST
    cloud = place.dsm.with_name("cloud.npy")
    np.save(cloud, np.column_stack((xy, np.full(500, 100.0))))
    return {"cloud": cloud}


def coloured(colour: int, share: float, nodata: float | None = None) -> Callable[[Place], None]:
    def changed(place: Place) -> None:
        ground = np.random.default_rng(0).integers(0, 256, (3, MAP_SIZE_M, MAP_SIZE_M), np.uint8)
        ground[:, : int(share * MAP_SIZE_M)] = colour
        write_raster(place.dom, ground, nodata=nodata)

    return changed


def flipped(turn: Any) -> Callable[[Place], None]:
    def changed(place: Place) -> None:
        rng = np.random.default_rng(1)
        holes = np.kron(rng.random((32, 32)) < 0.3, np.ones((8, 8), bool))
        ground = np.where(holes, 0, rng.integers(1, 256, (3, *holes.shape))).astype(np.uint8)
        write_raster(place.dsm, np.where(holes, np.nan, LEVEL))
        write_raster(place.dom, ground[turn], nodata=0)

    return changed


def one_far(place: Place) -> None:
    x, y = place.centres["a.jpg"]
    place.change_image("a.jpg", center=[NORTH_WEST[0] + x + 60, NORTH_WEST[1] - y, 200.0])


def cut_surface(side: int) -> Callable[[Place], None]:
    return lambda place: write_raster(place.dsm, LEVEL[:, :side, :side]) and None


def in_beijing_1954(place: Place) -> None:
    ground = np.random.default_rng(0).integers(0, 256, (3, MAP_SIZE_M, MAP_SIZE_M), np.uint8)
    write_raster(place.dom, ground, crs="EPSG:2437")
    write_raster(place.dsm, LEVEL, crs="EPSG:2437")
    place.change_poses(crs="EPSG:2437")
    for name in NAMES:
        tag(place, name, crs="EPSG:2437")
