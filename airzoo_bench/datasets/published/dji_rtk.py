"""True positions and cameras of a DJI drone with RTK: tables (.MRK), and what photos state.

A line of ``*_Timestamp.MRK`` holds the photo's number, GPS time, offsets from antenna to camera,
the camera's latitude, longitude and height above the ellipsoid, each with its name, and the kind
of solution: ``50,Q`` is RTK with fixed ambiguities.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.datasets.dji import PhotoPrior, read_dji_texts
from airzoo_bench.datasets.priors import read_prior_file
from airzoo_bench.datasets.surveys.lenses import lens_of, read_camera_file
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.frames import geodesic_distance_m

__all__ = ["TruePositions", "metadata_cameras", "true_positions"]

_FIXED = "50"
_NUMBER = r"(-?\d+(?:\.\d+)?)\s*,\s*"
_LINE = re.compile(
    rf"\s*(\d+)\s.*?{_NUMBER}Lat\b.*?{_NUMBER}Lon\b.*?{_NUMBER}Ellh\b.*?(\d+)\s*,\s*Q\b"
)
_PHOTO_NUMBER = re.compile(r"_(\d{4})(?:_[A-Z])?$")
_SAME_PLACE_M = 100.0  # of a table's position and the photo's own
_DEWARP = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
_CALIBRATED = ("CalibratedFocalLength", "CalibratedOpticalCenterX", "CalibratedOpticalCenterY")


@dataclass(frozen=True)
class TruePositions:
    """Where photos were taken, by the best that is there.

    Attributes
    ----------
    positions : mapping of str to PhotoPrior
        True position and the gimbal's angles, by the photo's name.
    said : str
        Where they are from, a sentence for the user.
    path : Path or None
        Their file.
    """

    positions: Mapping[str, PhotoPrior]
    said: str
    path: Path | None = None


@dataclass(frozen=True)
class _Row:
    number: int
    lat: float
    lon: float
    height_m: float
    fixed: bool


def true_positions(
    home: Path, metadata: Mapping[str, PhotoPrior], tables: Sequence[Path], given: Path | None
) -> TruePositions:
    """Return true positions: those of a file, else of RTK tables, else of the photos themselves.

    Tables count where they have a fixed solution for every photo, told by the number in its name;
    of the photos' own positions those that say that they are fixed RTK. Sources are not mixed.

    Parameters
    ----------
    home : Path
        Folder of the photos.
    metadata : mapping of str to PhotoPrior
        By their names.
    tables : sequence of Path
    given : Path or None
        A CSV, see `priors.read_prior_file`.

    Raises
    ------
    BenchmarkError
        A file is damaged.
    """
    if given is not None:
        rows = read_prior_file(given, metadata)
        found = {name: replace(metadata[name], **values) for name, values in rows.items()}
        return _complete(found, f"true positions are those of {given.name}", given)
    by_table, why = _of_tables(metadata, tables)
    if by_table:
        names = first_of([table.name for table in tables])
        said = f"true positions are the fixed RTK solutions of {names}"
        return _complete(by_table, said, tables[0])
    own = {
        name: prior
        for name, prior in metadata.items()
        if read_dji_texts(home / name).get("RtkFlag") == _FIXED
    }
    said = f"true positions are those of the metadata of {len(own)} of {len(metadata)} photos, "
    return _complete(own, f"{said}fixed RTK by their RtkFlag{why}")


def _complete(
    found: Mapping[str, PhotoPrior], said: str, path: Path | None = None
) -> TruePositions:
    whole = {name: prior for name, prior in found.items() if prior.is_complete}
    return TruePositions(whole, f"{said}; orientations are the gimbal's, and not trusted", path)


def _of_tables(
    metadata: Mapping[str, PhotoPrior], tables: Sequence[Path]
) -> tuple[dict[str, PhotoPrior], str]:
    if not tables:
        return {}, ""
    rows = [row for table in tables for row in _read_table(table)]
    found: dict[str, PhotoPrior] = {}
    for name, prior in metadata.items():
        match = _PHOTO_NUMBER.search(Path(name).stem)
        number = int(match[1]) if match is not None else -1
        fitting = [row for row in rows if row.number == number and _near(row, prior)]
        if len(fitting) == 1 and fitting[0].fixed:
            row = fitting[0]
            found[name] = replace(prior, lon=row.lon, lat=row.lat, altitude_m=row.height_m)
    if len(found) == len(metadata):
        return found, ""
    lacking = [name for name in metadata if name not in found]
    named = first_of([table.name for table in tables])
    return {}, (
        f" ({named} not used: no single fixed solution within {_SAME_PLACE_M:g} m of "
        f"{first_of(lacking, len(metadata))})"
    )


def _near(row: _Row, prior: PhotoPrior) -> bool:
    if prior.lon is None or prior.lat is None:
        return True
    places = np.array(((row.lon, row.lat), (prior.lon, prior.lat)))
    return float(geodesic_distance_m(places[:1], places[1:])[0]) < _SAME_PLACE_M


def _read_table(path: Path) -> list[_Row]:
    rows = []
    for number, line in enumerate(read_text(path, BenchmarkError, "RTK table").splitlines(), 1):
        if not line.strip():
            continue
        match = _LINE.match(line)
        if match is None:
            raise BenchmarkError(
                f"not a line of DJI's RTK table: {line[:80]!r}",
                where=f"{path}, line {number}",
                expected="photo number, time, offsets, then 28.1234,Lat 112.1234,Lon 45.67,Ellh "
                "and 50,Q",
                fix="download it again; or give positions with --positions SCENE=FILE",
            )
        lat, lon, height = (float(match[group]) for group in (2, 3, 4))
        rows.append(_Row(int(match[1]), lat, lon, height, match[5] == _FIXED))
    return rows


def metadata_cameras(
    home: Path, sizes: Mapping[str, tuple[int, int]], given: Path | None, scene: str
) -> Cameras:
    """Return cameras: of a file, else as DJI calibrated them (DewarpData, CalibratedFocalLength).

    Parameters
    ----------
    home : Path
    sizes : mapping of str to (width, height)
        By the photo's name.
    given : Path or None
        JSON, see `surveys.lenses.read_camera_file`.
    scene : str
        For messages.

    Raises
    ------
    UserError
        A photo states no calibration, or a damaged one.
    """
    values = None if given is None else read_camera_file(given)
    lacking, lenses = [], []
    for name, size in sizes.items():
        lens = values if values is not None else _stated_lens(home / name, size)
        if lens is None:
            lacking.append(name)
        else:
            lenses.append(lens_of(lens, size, given or home / name))
    if lacking:
        raise CameraError(
            f"no calibrated camera in the metadata of {first_of(lacking, len(sizes))}",
            where=home,
            expected="DJI's DewarpData or CalibratedFocalLength",
            fix=f"--camera {scene}=FILE, JSON with fx (px), or focal_mm and sensor_mm, or fov_deg",
        )
    matrices, distortion = zip(*lenses, strict=True)
    width, height = np.array(list(sizes.values())).T
    return Cameras.from_matrices(
        np.array(matrices), width, height, np.array(distortion), names=list(sizes)
    )


def _stated_lens(path: Path, size: tuple[int, int]) -> dict[str, float] | None:
    texts = read_dji_texts(path)
    if "DewarpData" in texts:
        parts = _floats(path, "DewarpData", texts["DewarpData"].rpartition(";")[2], len(_DEWARP))
        lens = dict(zip(_DEWARP, parts, strict=True))
        # Offsets from the middle of the photo.
        lens["cx"], lens["cy"] = size[0] / 2 + lens["cx"], size[1] / 2 + lens["cy"]
        undistorted = texts.get("DewarpFlag") == "1"
        return {k: v for k, v in lens.items() if not undistorted or k in ("fx", "fy", "cx", "cy")}
    if all(name in texts for name in _CALIBRATED):
        fx, cx, cy = (_floats(path, name, texts[name], 1)[0] for name in _CALIBRATED)
        return {"fx": fx, "cx": cx, "cy": cy}
    return None


def _floats(path: Path, name: str, text: str, count: int) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise CameraError(f"DJI's {name} is {text[:60]!r}", where=path, expected=f"{count} numbers")
    return values
