"""Photos with GPS and gimbal angles in their metadata, such as those of a made-up place."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from airzoo_bench.geometry.crs import to_lonlat
from tests.support import MAP_SIZE_M, NORTH_WEST, PLACE_CRS, Place

LEVEL = np.full((1, MAP_SIZE_M, MAP_SIZE_M), 100, np.float32)
LEVEL[0, 0, 0] = 99.5  # where no photo looks: a surface of one height is suspect
NAMES = ("a.jpg", "b.jpg", "c.jpg", "sub/d.jpg")
_DJI = 'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"'


def packet(attributes: str = "", elements: str = "", before: str = "") -> bytes:
    """Return DJI's XMP, as photos carry it."""
    text = (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>'
        f'{before}<x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" {_DJI} {attributes}>{elements}</rdf:Description>'
        '</rdf:RDF></x:xmpmeta>\n   <?xpacket end="w"?>\0'
    )
    return text.encode()


def write_photo(
    path: Path,
    size: tuple[int, int],
    gps: Mapping[int, Any] | None = None,
    xmp: bytes | None = None,
    film_mm: int | None = None,
) -> None:
    """Write a photo with a GPS part of EXIF, XMP and a focal length of 35 mm film."""
    exif, stream = Image.Exif(), io.BytesIO()
    if gps is not None:
        exif.get_ifd(0x8825).update(gps)
    if film_mm is not None:
        exif.get_ifd(0x8769)[0xA405] = film_mm
    Image.new("L", size).save(stream, "JPEG", exif=exif)
    content, head = stream.getvalue(), b""
    if xmp is not None:
        xmp = b"http://ns.adobe.com/xap/1.0/\0" + xmp
        head = b"\xff\xe1" + (len(xmp) + 2).to_bytes(2) + xmp
    path.write_bytes(content[:2] + head + content[2:])


def tag(place: Place, name: str, *, like: str | None = None, up: float = 2.0, **dji: Any) -> None:
    """Write GPS, 2 m off the pose, and gimbal angles into a photo; None leaves a value out."""
    x, y = place.centres[like or name]
    lon, lat = to_lonlat(PLACE_CRS, (NORTH_WEST[0] + x + 1.5, NORTH_WEST[1] - y - 1.5)).tolist()
    gps = {1: "N", 2: (lat, 0.0, 0.0), 3: "E", 4: (lon, 0.0, 0.0), 5: b"\0", 6: 200.0 + up}
    values = {"RelativeAltitude": 100.0, "GimbalYawDegree": 0.0, "GimbalPitchDegree": -89.0}
    values |= {"GimbalRollDegree": 0.0} | dji
    texts = [
        f'drone-dji:{key}="{value:+.2f}"' for key, value in values.items() if value is not None
    ]
    write_photo(place.images / name, (64, 48), gps, packet(" ".join(texts)))
