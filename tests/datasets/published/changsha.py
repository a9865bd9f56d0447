"""A made-up place in EPSG:4547, its cameras, photos with metadata, and rasters as DJI Terra's."""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from PIL import Image
from pyproj import CRS
from rasterio import Affine
from rasterio.errors import NotGeoreferencedWarning

from airzoo_bench.geometry.crs import grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses, angles_to_rotations
from tests.datasets.xmp import packet
from tests.support import write_raster

Bands = NDArray[np.uint8] | NDArray[np.float32]

EPSG = 4547
CORNER = (401_000.0, 3_131_000.0)  # north-west
SIDE_M = 360.0
GROUND_M = 50.0
SIZE_PX = (40, 30)
FOCAL_PX = 40.0


@dataclass(frozen=True)
class Shot:
    """A photo by what its gimbal says and where it is, in metres from the north-west corner."""

    x: float
    y: float
    up: float = 100.0
    yaw: float = 0.0
    pitch: float = -60.0

    @property
    def centre(self) -> tuple[float, float, float]:
        return CORNER[0] + self.x, CORNER[1] - self.y, GROUND_M + self.up

    def moved(self, x: float = 0.0, y: float = 0.0, up: float = 0.0, yaw: float = 0.0) -> Shot:
        return Shot(self.x + x, self.y + y, self.up + up, self.yaw + yaw, self.pitch)


def poses_of_shots(shots: Mapping[str, Shot]) -> Poses:
    centres = np.array([shot.centre for shot in shots.values()])
    convergence = grid_convergence_deg(EPSG, to_lonlat(EPSG, centres[:, :2]))
    yaw, pitch = np.array([(shot.yaw, shot.pitch) for shot in shots.values()]).T
    rotation = angles_to_rotations(yaw, pitch, 0.0, convergence_deg=convergence)
    return Poses.from_centres(rotation, centres)


def heights(pixel_m: float) -> Bands:
    count = round(SIDE_M / pixel_m)
    x = (np.arange(count) + 0.5) * pixel_m
    hills = GROUND_M + 4.0 * np.sin(x / 40.0) + 3.0 * np.cos(x / 30.0)[:, None]
    return np.asarray(hills[None], np.float32)


def grid(pixel_m: float) -> Affine:
    return Affine(pixel_m, 0, CORNER[0], 0, -pixel_m, CORNER[1])


def write_map(path: Path, pixel_m: float, *, seed: int = 0, bare: bool = False) -> Path:
    """Write a map of noise; `bare`, with its georeference in .tfw and .prj only."""
    count = round(SIDE_M / pixel_m)
    pixels = np.random.default_rng(seed).integers(1, 256, (3, count, count), np.uint8)
    return _write(path, pixels, pixel_m, None, bare)


def write_surface(
    path: Path,
    pixel_m: float,
    *,
    bare: bool = False,
    hole: bool = False,
    nodata: float | None = -9999.0,
) -> Path:
    values = heights(pixel_m)
    if hole:
        values[:, :6, :6] = -9999.0
    return _write(path, values, pixel_m, nodata, bare)


def _write(path: Path, bands: Bands, pixel_m: float, nodata: float | None, bare: bool) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    if not bare:
        return write_raster(path, bands, crs=f"EPSG:{EPSG}", transform=grid(pixel_m), nodata=nodata)
    write_bare(path, bands, nodata)
    half = pixel_m / 2
    values = (pixel_m, 0, 0, -pixel_m, CORNER[0] + half, CORNER[1] - half)
    path.with_suffix(".tfw").write_text("".join(f"{value}\n" for value in values))
    path.with_suffix(".prj").write_text(CRS.from_epsg(EPSG).to_wkt("WKT1_GDAL"))
    return path


def write_bare(path: Path, bands: Bands, nodata: float | None) -> None:
    """Write a GeoTIFF without any georeference in it."""
    count, height, width = bands.shape
    shape = {"count": count, "height": height, "width": width}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path, "w", "GTiff", dtype=bands.dtype, nodata=nodata, **shape) as file:
            file.write(bands)


def write_photo(
    path: Path, shot: Shot | None, size: tuple[int, int] = SIZE_PX, **tags: object
) -> None:
    """Write a photo of noise whose metadata say that it was taken by this shot, if any."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(len(path.name)).integers(0, 256, (size[1], size[0], 3), np.uint8)
    exif, values = Image.Exif(), {f"drone-dji:{key}": value for key, value in tags.items()}
    if shot is not None:
        x, y, z = shot.centre
        lon, lat = to_lonlat(EPSG, (x, y)).tolist()
        exif.get_ifd(0x8825).update(
            {1: "N", 2: (lat, 0.0, 0.0), 3: "E", 4: (lon, 0.0, 0.0), 5: b"\0", 6: z}
        )
        values |= {
            "drone-dji:RelativeAltitude": f"{shot.up:+.2f}",
            "drone-dji:GimbalYawDegree": f"{shot.yaw:+.2f}",
            "drone-dji:GimbalPitchDegree": f"{shot.pitch:+.2f}",
            "drone-dji:GimbalRollDegree": "+0.00",
            "drone-dji:GpsLatitude": f"{lat:+.10f}",
            "drone-dji:GpsLongitude": f"{lon:+.10f}",
            "drone-dji:AbsoluteAltitude": f"{z:+.3f}",
        }
    text = " ".join(f'{key}="{value}"' for key, value in values.items())
    data = b"http://ns.adobe.com/xap/1.0/\0" + packet(text)
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", exif=exif)
    content = stream.getvalue()
    head = b"\xff\xe1" + (len(data) + 2).to_bytes(2)
    path.write_bytes(content[:2] + head + data + content[2:])
