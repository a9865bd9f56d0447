"""Tiles and crops that `prepare` wrote, held to the maps; photos with positions and angles."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import rasterio
from PIL import Image

from airzoo_bench.api.benchmark import BlindScene
from airzoo_bench.geometry.crs import to_lonlat
from tests.support import MAP_SIZE_M, NORTH_WEST, PLACE_CRS, Place, files_below

BOX = ["lon_min", "lat_min", "lon_max", "lat_max"]
TRANSFORM = list("abcdef")


def hold_files(folder: Path, table: str, *columns: str) -> pd.DataFrame:
    """Hold the files of a folder to those that its table names once, and return the table."""
    listed = pd.read_csv(folder / table)
    named = {file for column in columns for file in listed[column]}
    assert len(named) == len(columns) * len(listed)
    there = {name for name in files_below(folder) if (folder / name).is_file()}
    assert there == {table, *named}
    return listed


def hold_tiles(home: Path, scene: BlindScene) -> None:
    """Hold all tile files below a scene's folder to the tiles of the scene."""
    folder, tiles = home / "retrieval" / "tiles", scene.tiles()
    listed = hold_files(folder, "tiles.csv", "file")
    assert listed["id"].tolist() == [tile.id for tile in tiles]
    for row, tile in list(zip(listed.itertuples(), tiles, strict=True))[::7]:
        with Image.open(folder / str(row.file)) as image:
            np.testing.assert_array_equal(np.asarray(image), tile.image)
        assert listed.loc[row.Index, BOX].tolist() == list(tile.box)
        assert listed.loc[row.Index, ["x", "y", "width", "height"]].tolist() == list(tile.window)
        with rasterio.open(tile.path) as whole:
            assert row.c == whole.transform.c + whole.transform.a * tile.window[0]


def hold_crops(home: Path, scene: BlindScene) -> None:
    """Hold all crop files below a scene's folder to the crops of the scene."""
    folder, crops = home / "matching" / "crops", scene.crops()
    listed = hold_files(folder, "crops.csv", "dom_file", "dsm_file")
    assert listed["id"].tolist() == [crop.query.id for crop in crops]
    for row, crop in list(zip(listed.itertuples(), crops, strict=True))[::3]:
        with rasterio.open(folder / str(row.dom_file)) as dom:
            np.testing.assert_array_equal(np.moveaxis(dom.read(), 0, -1)[..., :3], crop.image)
            assert dom.transform[:6] == tuple(listed.loc[row.Index, TRANSFORM])
            assert dom.crs == rasterio.CRS.from_string(str(row.crs))
        assert crop.to_world([[0, 0]]).tolist() == [[row.c, row.f]]


# --- photos with GPS and gimbal angles in their metadata ---

LEVEL = np.full((1, MAP_SIZE_M, MAP_SIZE_M), 100, np.float32)
LEVEL[0, 0, 0] = 99.5  # where no photo looks: a surface of one height is suspect
NAMES = ("a.jpg", "b.jpg", "c.jpg", "sub/d.jpg")
_DJI = 'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"'


def packet(elements: str = "", before: str = "", **values: str) -> bytes:
    """Return DJI's XMP with some values, as photos carry it."""
    attributes = " ".join(f'drone-dji:{key}="{value}"' for key, value in values.items())
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>'
        f'{before}<x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" {_DJI} {attributes}>{elements}</rdf:Description>'
        '</rdf:RDF></x:xmpmeta>\n   <?xpacket end="w"?>\0'
    ).encode()


def write_photo(path: Path, size: tuple[int, int], gps: Any = None, xmp: Any = None) -> None:
    """Write a photo with a GPS part of EXIF, by its tags, and the bytes of XMP."""
    exif, stream = Image.Exif(), io.BytesIO()
    exif.get_ifd(0x8825).update(gps or {})
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
    texts = {key: f"{value:+.2f}" for key, value in values.items() if value is not None}
    write_photo(place.images / name, (64, 48), gps, packet(**texts))
