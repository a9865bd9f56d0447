"""What photos and their files say, held against their poses: heights, GPS, cameras, days."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date, datetime
from numbers import Real
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.queries import SceneInputs, poses_of
from airzoo_bench.datasets.photo_metadata import PhotoPrior
from airzoo_bench.formats.photos import opened_photo
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import LOCAL_CRS, from_lonlat, geodesic_distance_m, to_lonlat
from airzoo_bench.geometry.heightfield import blocked_heights
from airzoo_bench.geometry.rays import nearest_heights

__all__ = [
    "Cameras3D",
    "GpsFacts",
    "PhotoFiles",
    "camera_facts",
    "gps_facts",
    "median",
    "survey_photos",
]

_NEAREST_OF_PX = 1_000_000


@dataclass(frozen=True, eq=False)
class Cameras3D:
    """Cameras over the surface model.

    Attributes
    ----------
    heights_m : (N,) array
        Of each camera above the surface below it, or the nearest height there is; NaN where there
        is none.
    surface_m : (N,) array
        The height of that surface.
    relative_m : (N,) array
        Above the place of take-off by the photo's own word; NaN where it has none.
    """

    heights_m: Floats
    surface_m: Floats
    relative_m: Floats

    @property
    def height_m(self) -> float:
        """Median height above the surface."""
        return median(self.heights_m)

    @property
    def relative_height_m(self) -> float:
        """Median height above take-off; NaN where no photo has one."""
        return median(self.relative_m)

    @property
    def below(self) -> int:
        """Cameras on the surface or below."""
        return int((self.heights_m <= 0.0).sum())


@dataclass(frozen=True)
class GpsFacts:
    """Poses against the photos' own GPS.

    Attributes
    ----------
    photos : int
        Photos that have a position.
    distance_m, height_m : float
        Median horizontal distance, and median of pose less GPS in height (NaN without altitudes).
    offset_m : tuple of float
        Median of pose less GPS, east and north.
    """

    photos: int
    distance_m: float
    height_m: float
    offset_m: tuple[float, float]


def camera_facts(inputs: SceneInputs, metadata: Mapping[str, PhotoPrior]) -> Cameras3D:
    """Measure how high cameras are above the surface model, or else above the plane z0."""
    photos = inputs.photos
    relative = [metadata.get(name, PhotoPrior()).relative_altitude_m for name in photos["image"]]
    if "z" not in photos:
        nowhere = np.full(len(photos), np.nan)
        return Cameras3D(nowhere, nowhere, np.array(relative, dtype=np.float64))
    centres = poses_of(photos).centres
    found = _ground_below(centres, inputs)
    return Cameras3D(centres[:, 2] - found, found, np.array(relative, dtype=np.float64))


def _ground_below(centres: Floats, inputs: SceneInputs) -> Floats:
    if inputs.dsm is None:
        plane = math.nan if inputs.plane_height_m is None else inputs.plane_height_m
        return np.full(len(centres), plane)
    with blocked_heights(inputs.dsm) as field:
        found = field.sample(centres[:, :2])
        gap = np.isnan(found)
        if gap.any():
            found[gap] = nearest_heights(field, _NEAREST_OF_PX)(centres[gap, :2])
    return found


def gps_facts(inputs: SceneInputs, metadata: Mapping[str, PhotoPrior]) -> GpsFacts | None:
    """Compare poses with the photos' own GPS; None where no photo has a position."""
    if inputs.crs in (None, LOCAL_CRS):
        return None
    rows = [metadata.get(name, PhotoPrior()) for name in inputs.photos["image"]]
    placed = np.array([row.lon is not None for row in rows], dtype=bool)
    if not placed.any():
        return None
    lonlat = np.array([[row.lon, row.lat] for row in rows], np.float64)
    centres = poses_of(inputs.photos).centres
    true_lonlat, apart = to_lonlat(inputs.crs, centres[:, :2]), centres.copy()
    apart[:, :2] -= from_lonlat(inputs.crs, lonlat)
    apart[:, 2] -= np.array([row.altitude_m for row in rows], np.float64)
    middle = np.array([median(apart[placed, axis]) for axis in range(3)])
    # A position beyond the projection is far, not unknown.
    metres = np.hypot(apart[:, 0], apart[:, 1])
    metres = np.where(np.isnan(metres), geodesic_distance_m(lonlat, true_lonlat), metres)
    return GpsFacts(
        int(placed.sum()),
        median(metres[placed]),
        float(middle[2]),
        (float(middle[0]), float(middle[1])),
    )


def median(values: Floats) -> float:
    """Median of the finite values; NaN where there are none."""
    there = values[np.isfinite(values)]
    return float(np.median(there)) if there.size else math.nan


_MODEL, _EXIF_IFD, _TAKEN, _FOCAL_MM, _SERIAL = 0x0110, 0x8769, 0x9003, 0x920A, 0xA431


@dataclass(frozen=True)
class PhotoFiles:
    """Photos of a scene as files.

    Attributes
    ----------
    cameras : mapping of str to tuple of str
        Names by camera (model, serial number, focal length), as EXIF has it; photos that do not
        say are left out.
    days : tuple of date
        On which the photos were taken, ascending; those that say.
    """

    cameras: Mapping[str, tuple[str, ...]]
    days: tuple[date, ...]


def survey_photos(folder: Path, names: Iterable[str]) -> PhotoFiles:
    """Find which camera took photos, and on which days."""
    said = {name: _camera_and_day(folder / name) for name in names}
    cameras = _grouped({name: camera for name, (camera, _) in said.items() if camera})
    days = sorted({day for _, day in said.values() if day is not None})
    return PhotoFiles(cameras, tuple(days))


def _grouped(keys: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    found: dict[str, list[str]] = {}
    for name in sorted(keys):
        found.setdefault(keys[name], []).append(name)
    return {key: tuple(names) for key, names in found.items()}


def _camera_and_day(path: Path) -> tuple[str, date | None]:
    with opened_photo(path) as image:
        exif = image.getexif()
        model, more = exif.get(_MODEL), exif.get_ifd(_EXIF_IFD)
    serial, focal = more.get(_SERIAL), more.get(_FOCAL_MM)
    length = float(focal) if isinstance(focal, Real) else 0.0
    parts = [_text(model), f"no. {_text(serial)}" if _text(serial) else ""]
    parts.append(f"at {length:g} mm" if length > 0.0 else "")
    return " ".join(part for part in parts if part), _day(_text(more.get(_TAKEN)))


def _text(value: object) -> str:
    """Return an EXIF text, which may hold anything, without unprintable characters."""
    text = value.strip("\0 ") if isinstance(value, str) else ""
    return "".join(one for one in text if one.isprintable())[:40]


def _day(text: str) -> date | None:
    try:
        return datetime.strptime(text, "%Y:%m:%d %H:%M:%S").date()
    except ValueError:  # not stated, or all zero where the camera's clock was not set
        return None
