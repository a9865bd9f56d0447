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


def high_cloud(place: Place) -> dict[str, object]:
    xy = np.random.default_rng(0).uniform(10, 240, (500, 2)) * (1, -1) + NORTH_WEST
    cloud = place.dsm.with_name("cloud.npy")
    np.save(cloud, np.column_stack((xy, np.full(500, 127.5))))
    return {"cloud": cloud}


def small_map(place: Place) -> None:
    dom = np.full((3, 88, 100), 9, np.uint8)
    grid = Affine(1, 0, NORTH_WEST[0] + 10, 0, -1, NORTH_WEST[1] - 20)
    write_raster(place.dom, dom, transform=grid)


def no_metadata(place: Place) -> None:
    Image.new("L", (64, 48), 7).save(place.images / "a.jpg")


def in_float32(place: Place) -> None:
    for number, (name, image) in enumerate(place.read_poses()["images"].items()):
        x, y, z = (float(np.float32(value + 0.28 + 0.4 * number)) for value in image["center"])
        place.change_image(name, center=[x, y, z])


def tower(place: Place) -> None:
    heights = LEVEL.copy()
    heights[0, 54:74, 54:74] = 300.0
    write_raster(place.dsm, heights)


def cloud_beside(place: Place) -> dict[str, object]:
    xy = np.random.default_rng(0).uniform(300, 400, (500, 2)) * (1, -1) + NORTH_WEST
    cloud = place.dsm.with_name("cloud.npy")
    np.save(cloud, np.column_stack((xy, np.full(500, 100.0))))
    return {"cloud": cloud}


def cut_surface(place: Place) -> None:
    write_raster(place.dsm, LEVEL[:, :100, :100])


def sound(place: Place) -> None:
    """Leave the place as it is."""


def flat(place: Place) -> None:
    write_raster(place.dsm, np.full_like(LEVEL, 100.0))


def map_beside(place: Place) -> None:
    ground = np.random.default_rng(0).integers(0, 256, (3, MAP_SIZE_M, MAP_SIZE_M), np.uint8)
    grid = Affine(1, 0, NORTH_WEST[0] + 180, 0, -1, NORTH_WEST[1])
    write_raster(place.dom, ground, transform=grid)


def few_tiles(place: Place) -> dict[str, object]:
    return {"tile_size": 150}


def small_tiles(place: Place) -> dict[str, object]:
    return {"tile_size": 32}


def copies(place: Place) -> None:
    image = place.read_poses()["images"]["a.jpg"]
    place.change_image("b.jpg", **image)
    tag(place, "b.jpg", like="a.jpg")


gps_of_another_datum = retag(NAMES, up=30.0)
yaw_by_178 = retag(NAMES[1:3], yaw=178.0)
yaw_by_90 = retag(NAMES, yaw=90.0)
no_gimbal = retag(NAMES[:1], yaw=None)
