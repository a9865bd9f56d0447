"""Tiles and crops that `prepare` wrote, held to the maps; photos with positions and angles."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import rasterio
from PIL import Image

from airzoo_bench.api.benchmark import BlindScene
from airzoo_bench.geometry.crs import to_lonlat
from tests.support import MAP_SIZE_M, NORTH_WEST, PLACE_CRS, Place

BOX = ["lon_min", "lat_min", "lon_max", "lat_max"]
TRANSFORM = list("abcdef")


def files_below(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def hold_tiles(home: Path, scene: BlindScene) -> None:
    """Hold all tile files below a scene's folder to the tiles of the scene."""
    listed = pd.read_csv(home / "retrieval" / "tiles" / "tiles.csv")
    assert listed["id"].tolist() == [tile.id for tile in scene.tiles()]
    assert files_below(home / "retrieval" / "tiles") == {"tiles.csv", *listed["file"]}
    for row, tile in list(zip(listed.itertuples(), scene.tiles(), strict=True))[::7]:
        with Image.open(home / "retrieval" / "tiles" / str(row.file)) as image:
            np.testing.assert_array_equal(np.asarray(image), tile.image)
        assert listed.loc[row.Index, BOX].tolist() == list(tile.box)
        assert listed.loc[row.Index, ["x", "y", "width", "height"]].tolist() == list(tile.window)
        with rasterio.open(tile.path) as whole:
            corner = whole.transform.c + whole.transform.a * tile.window[0]
        assert row.c == corner


def hold_crops(home: Path, scene: BlindScene) -> None:
    """Hold all crop files below a scene's folder to the crops of the scene."""
    listed = pd.read_csv(home / "matching" / "crops" / "crops.csv")
    assert listed["id"].tolist() == [crop.query.id for crop in scene.crops()]
    both = {*listed["dom_file"], *listed["dsm_file"]}
    assert len(both) == 2 * len(listed)
    assert files_below(home / "matching" / "crops") == {"crops.csv", *both}
    for row, crop in list(zip(listed.itertuples(), scene.crops(), strict=True))[::3]:
        with rasterio.open(home / "matching" / "crops" / str(row.dom_file)) as dom:
            np.testing.assert_array_equal(np.moveaxis(dom.read(), 0, -1)[..., :3], crop.image)
            assert dom.transform[:6] == tuple(listed.loc[row.Index, TRANSFORM])
            assert dom.crs == rasterio.CRS.from_string(str(row.crs))
        assert crop.to_world([[0, 0]]).tolist() == [[row.c, row.f]]


# --- photos with GPS and gimbal angles in their metadata ---

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
