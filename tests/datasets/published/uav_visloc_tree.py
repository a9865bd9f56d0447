"""UAV-VisLoc's tree as it is downloaded: photos of known place and heading over empty maps.

`python -m tests.datasets.published.uav_visloc_tree FOLDER` makes it.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from affine import Affine
from numpy.typing import NDArray
from PIL import Image
from pyproj import Geod

from airzoo_bench.core.progress import silent
from airzoo_bench.datasets.published.uav_visloc import UAV_VISLOC, UavVisLocOptions
from airzoo_bench.datasets.scenes import NativeScene

PIXEL_DEG = 360 / 2**27
HEADER = "num,filename,date,lat,lon,height,Omega,Kappa,Phi1,Phi2"
PHOTO_SIZE = (60, 40)
EARTH = Geod(ellps="WGS84")
FOV_DEG = (52.0, 36.0)


@dataclass(frozen=True)
class Flight:
    """Where its map and photos are; photos are (lon, lat, height, phi) each, phi by the compass."""

    name: str
    corner: tuple[float, float]
    size: tuple[int, int]
    photos: tuple[tuple[float, float, float, float], ...]
    cuts: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())
    columns: int = 10

    def photo(self, index: int) -> str:
        return f"{self.name}_{index + 1:04d}.JPG"


def along(
    start: tuple[float, float], height: float, phis: Sequence[float], metres: float
) -> tuple[tuple[float, float, float, float], ...]:
    """Place photos one after the other to the east of a place, each with its heading."""
    lon, lat = start
    places = (EARTH.fwd(lon, lat, 90.0, metres * i)[:2] for i in range(len(phis)))
    return tuple((lon, lat, height, phi) for (lon, lat), phi in zip(places, phis, strict=True))


FLIGHTS = {
    flight.name: flight
    for flight in (
        Flight(
            "01",
            (115.97, 29.77),
            (6000, 3000),
            along((115.9733, 29.7660), 405.0, (165.0, 30.0, -100.0, 80.0, 10.0), 200.0),
        ),
        Flight(
            "07",
            (115.791182, 40.345),
            (5000, 2600),
            along((115.7953, 40.3416), 300.0, (-1.5,) * 3, 150.0),
            columns=6,
        ),
        Flight(
            "09",
            (120.03, 30.99),
            (5000, 4000),
            along((120.0340, 30.9846), 450.0, (-50.0, 20.0, 135.0, 60.0), 200.0),
            cuts=((2600,), (1800,)),
        ),
    )
}


def make_tree(root: Path, flights: Mapping[str, Flight] = FLIGHTS, *, photos: bool = True) -> Path:
    """Write the tree."""
    for flight in flights.values():
        write_flight(root / flight.name, flight, photos=photos)
    return root


def write_flight(folder: Path, flight: Flight, *, photos: bool = True) -> None:
    (folder / "drone").mkdir(parents=True)
    rows = [",".join(HEADER.split(",")[: flight.columns])]
    for index, (lon, lat, height, phi) in enumerate(flight.photos):
        name = flight.photo(index)
        if photos:
            Image.new("RGB", PHOTO_SIZE, (90, 120, 80)).save(folder / "drone" / name, "JPEG")
        values = (
            *(
                index + 1,
                name,
                f"2023-03-18T10:{index // 60:02d}:{index % 60:02d}",
                f"{lat:.9f}",
                f"{lon:.9f}",
            ),
            *(height, 1.5, -0.5, phi, phi + 3.0),
        )
        rows.append(",".join(map(str, values[: flight.columns])))
    (folder / f"{flight.name}.csv").write_text("\r\n".join([*rows, ""]))
    for name, window in map_files(flight).items():
        write_map(folder / name, flight, window)


def map_files(flight: Flight) -> dict[str, tuple[int, int, int, int]]:
    """Return the files of a map, with left, top, width and height in its pixels."""
    edges = [(0, *cuts, size) for cuts, size in zip(flight.cuts, flight.size, strict=True)]
    columns, rows = (list(pairwise(edge)) for edge in edges)
    if len(columns) == len(rows) == 1:
        return {f"satellite{flight.name}.tif": (0, 0, *flight.size)}
    return {
        f"satellite{flight.name}_{r:02d}-{c:02d}.tif": (left, top, right - left, bottom - top)
        for r, (top, bottom) in enumerate(rows, 1)
        for c, (left, right) in enumerate(columns, 1)
    }


def write_map(
    path: Path, flight: Flight, window: tuple[float, float, int, int], **profile: object
) -> None:
    """Write a map of which no pixel takes room on disk."""
    left, top, width, height = window
    settings: dict[str, object] = {
        "driver": "GTiff",
        "width": width,
        "height": height,
        "count": 3,
        "dtype": "uint8",
        "tiled": True,
        "sparse_ok": True,
        "photometric": "rgb",
        "crs": "EPSG:4326",
        "transform": Affine(
            *(PIXEL_DEG, 0, flight.corner[0] + left * PIXEL_DEG),
            *(0, -PIXEL_DEG, flight.corner[1] - top * PIXEL_DEG),
        ),
    }
    kept = {key: value for key, value in (settings | profile).items() if value is not None}
    with rasterio.open(path, "w", **kept):
        pass


def anchors(photo: tuple[float, float, float, float], share: float = 1.0) -> NDArray[np.float64]:
    """Return lon, lat of the corners of a footprint made smaller by `share`, over the ellipsoid.

    Top left, top right, bottom right, bottom left of the photo, its top towards the heading.
    """
    lon, lat, height, phi = photo
    half = height * np.tan(np.radians(FOV_DEG) / 2) * share
    corners = []
    for right, up in ((-1, 1), (1, 1), (1, -1), (-1, -1)):
        bearing = phi + np.degrees(np.arctan2(right * half[0], up * half[1]))
        corners.append(EARTH.fwd(lon, lat, bearing, float(np.hypot(*half)))[:2])
    return np.array(corners)


def answers(flight: Flight, index: int, tiles: Mapping[str, Sequence[float]]) -> list[str]:
    """Return the tiles (left, top, right, bottom in degrees) that hold an anchor of a photo.

    Those that hold the fewest come first: a footprint turned another way loses them first.
    """
    points = anchors(flight.photos[index], share=7 / 8)
    held = {
        tile: sum(left <= lon <= right and bottom <= lat <= top for lon, lat in points)
        for tile, (left, top, right, bottom) in tiles.items()
    }
    return sorted((tile for tile, count in held.items() if count), key=lambda t: (held[t], t))


def read(source: Path, flight: str, **options: Any) -> NativeScene:
    """Read a flight of a tree."""
    return UAV_VISLOC.read(UavVisLocOptions(source, **options), flight, silent)


if __name__ == "__main__":
    make_tree(Path(sys.argv[1]))
