"""Photos of a made-up place with GPS and gimbal angles in their metadata."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
from PIL import Image

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import to_lonlat
from tests.datasets.xmp import packet
from tests.support import MAP_SIZE_M, NORTH_WEST, PLACE_CRS, Place

LEVEL = np.full((1, MAP_SIZE_M, MAP_SIZE_M), 100, np.float32)


LEVEL[0, 0, 0] = 99.5  # where no photo looks: a surface of one height is suspect


NAMES = ("a.jpg", "b.jpg", "c.jpg", "sub/d.jpg")


def tag(
    place: Place,
    name: str,
    *,
    yaw: float | None = 0.0,
    pitch: float = -89.0,
    up: float = 2.0,
    relative: float | None = 100.0,
    camera: str | None = None,
    day: str = "",
    crs: str = PLACE_CRS,
    lonlat: Callable[[Floats], Floats] = lambda true: true,
    like: str | None = None,
) -> None:
    """Write GPS, 2 m off the pose, and gimbal angles into a photo; `lonlat` changes its place."""
    x, y = place.centres[like or name]
    true = to_lonlat(crs, (NORTH_WEST[0] + x + 1.5, NORTH_WEST[1] - y - 1.5))
    lon, lat = lonlat(true).tolist()
    exif = Image.Exif()
    exif.get_ifd(0x8825).update(
        {1: "N", 2: (lat, 0.0, 0.0), 3: "E", 4: (lon, 0.0, 0.0), 5: b"\0", 6: 200.0 + up}
    )
    if camera is not None:
        exif[0x0110] = camera
    exif.get_ifd(0x8769)[0x9003] = f"{day} 12:00:00"
    values = {"RelativeAltitude": relative}
    if yaw is not None:
        values |= {"GimbalYawDegree": yaw, "GimbalPitchDegree": pitch, "GimbalRollDegree": 0.0}
    texts = (
        f'drone-dji:{key}="{value:+.2f}"' for key, value in values.items() if value is not None
    )
    data = b"http://ns.adobe.com/xap/1.0/\0" + packet(" ".join(texts))
    stream = io.BytesIO()
    Image.new("L", (64, 48)).save(stream, "JPEG", exif=exif)
    content = stream.getvalue()
    head = b"\xff\xe1" + (len(data) + 2).to_bytes(2)
    (place.images / name).write_bytes(content[:2] + head + data + content[2:])
