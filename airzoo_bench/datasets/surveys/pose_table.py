"""Tables of poses as Metashape, Pix4D, DJI Terra and people write them: columns by known names."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, counted
from airzoo_bench.core.validation import nearest
from airzoo_bench.datasets.native_tables import NativeTable
from airzoo_bench.datasets.native_text import read_native_text
from airzoo_bench.geometry.arrays import Floats

__all__ = ["PoseTable", "read_pose_table"]

# What a column is called, without case, units in brackets, blanks, '_', '-', '.' and '#'.
_NAMES: Mapping[str, tuple[str, ...]] = {
    "image": ("image", "imagename", "label", "name", "filename", "file", "photo", "sourcefile"),
    "lat": ("lat", "latitude", "gpslatitude"),
    "lon": ("lon", "lng", "longitude", "gpslongitude", "gpslongtitude"),
    "x": ("x", "easting", "east", "e", "x/easting", "x/longitude"),
    "y": ("y", "northing", "north", "n", "y/northing", "y/latitude"),
    "height": (
        *("height", "altitude", "alt", "z", "z/altitude", "elevation", "ellipsoidalheight"),
        *("ellipsoidheight", "gpsaltitude", "absolutealtitude"),
    ),
    "yaw": ("yaw", "gimbalyaw", "gimbalyawdegree"),
    "pitch": ("pitch", "gimbalpitch", "gimbalpitchdegree"),
    "roll": ("roll", "gimbalroll", "gimbalrolldegree"),
    "omega": ("omega",),
    "phi": ("phi",),
    "kappa": ("kappa",),
    "focal_mm": ("focalmm", "focallengthmm"),
    "sensor_mm": ("sensormm", "sensorwidthmm"),
    "fov_deg": ("fovdeg", "fov", "hfov", "hfovdeg"),
    **{name: (name,) for name in ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")},
}
# Units in brackets in which no column can be; others, such as (WGS84), are passed over.
_GON = ("gon", "gons", "grad", "grads", "gradian", "gradians", "mil", "mils")
_LENGTHS = ("ft", "feet", "foot", "usft", "ftus", "ussurveyfoot", "yd", "km", "cm", "mm")
_RADIANS = ("rad", "rads", "radian", "radians")
# Metashape writes what was given, and what it found under the same names with this ending.
_FOUND = "est"
_POSE = ("lat", "lon", "x", "y", "height", "yaw", "pitch", "roll", "omega", "phi", "kappa")
_HEADINGS = ("heading", "azimuth", "bearing", "course")  # which people write for yaw
# Columns that may name a lens, beside bodies such as FC6310, and lenses that are not computed.
_LENS_NAMES = ("model", "cameramodel", "lensmodel", "distortionmodel", "projectiontype")
_OTHER_LENSES = {
    *("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"),
    *("FULL_OPENCV", "FOV", "FISHEYE", "FISHEYE_OPENCV", "EQUIRECTANGULAR", "SPHERICAL"),
}
_SEPARATORS = (",", ";", "\t", None)  # None: blanks
_HEADER_LINES = 20  # within which the header is looked for
_LEAST_COLUMNS = 4
_EXPECTED = (
    "columns such as image, latitude, longitude, height, yaw, pitch, roll; or image, easting, "
    "northing, height, omega, phi, kappa"
)


@dataclass(frozen=True, eq=False)
class PoseTable:
    """A table of poses, its columns by our names.

    Attributes
    ----------
    table : NativeTable
    header : mapping of str to str
        What the file calls them.
    estimated : bool
        Whether values that a program found were taken, where it also lists those it was given.
    may_be_degrees : bool
        Whether x and y, by any of their names, may be longitude and latitude: Metashape writes
        X/Longitude, and then X_est, for both.
    """

    table: NativeTable
    header: Mapping[str, str]
    estimated: bool
    may_be_degrees: bool

    def in_radians(self, columns: Sequence[str]) -> bool:
        """Whether the name of one of these columns says, in brackets, that it is in radians."""
        return any(_unit(self.header[column]) in _RADIANS for column in columns)

    def has(self, *columns: str) -> bool:
        """Whether all these columns are there."""
        return set(columns) <= set(self.header)

    def numbers(self, column: str, rows: list[int], most: float = math.inf) -> Floats:
        """Return the numbers of a column in some rows; NaN where a cell is empty."""
        return self.table.numbers(column, -most, most, empty=True)[rows]


def read_pose_table(path: Path) -> PoseTable:
    """Read a table of poses; commas, semicolons, tabs or blanks separate its values."""
    lines = read_native_text(path).splitlines()
    try:
        start, separator, names = _header(path, lines)
    except csv.Error as error:
        raise BenchmarkError(f"not a table: {error}", where=path, expected=_EXPECTED) from error
    header, estimated = _columns(path, names)
    places = {column: names.index(name) for column, name in header.items()}
    numbered = [
        (number, row)
        for number, row in _rows(path, lines, start + 1, separator)
        if not row[0].startswith("#")
    ]
    for number, row in numbered:
        _check_width(path, number, row, names)
    if not numbered:
        raise BenchmarkError("has no row of a photo", where=path, expected="a row for each photo")
    _refuse_other_lenses(path, names, [row for _, row in numbered])
    table = NativeTable(
        path,
        tuple(places),
        tuple(name for name in names if name not in header.values()),
        tuple(tuple(row[place].strip() for place in places.values()) for _, row in numbered),
        tuple(number for number, _ in numbered),
        decimal_commas=separator != ",",
    )
    table.require_unique("image")
    across = [name.casefold() for name in names if _column(name) in ("x", "lon")]
    return PoseTable(table, header, estimated, any("lon" in name for name in across))


def _split(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    return next(csv.reader(io.StringIO(line), delimiter=separator), [])


def _header(path: Path, lines: Sequence[str]) -> tuple[int, str | None, list[str]]:
    """Find the line that names most columns, and what separates them."""
    best: tuple[int, int, str | None, list[str]] = (0, 0, ",", [])
    for place, line in enumerate(lines[:_HEADER_LINES]):
        for separator in _SEPARATORS:
            names = [name.strip() for name in _split(line.lstrip("# \ufeff"), separator)]
            known = len({column for column in map(_column, names) if column is not None})
            if known > best[0]:
                best = (known, place, separator, names)
    if best[0] < _LEAST_COLUMNS:
        found = next((line for line in lines if line.strip()), "")
        raise BenchmarkError(
            f"has no line that names its columns; it begins with {found[:80]!r}",
            where=path,
            expected=_EXPECTED,
            fix="write a first line that names the columns",
        )
    return best[1], best[2], best[3]


def _plain(name: str) -> str:
    return re.sub(r"\[.*?\]|\(.*?\)|[\s_.#-]", "", name.casefold())


def _unit(name: str) -> str:
    """Return what stands in brackets in a name, as `_plain` would leave it."""
    found = re.search(r"\[(.*?)\]|\((.*?)\)", name.casefold())
    return re.sub(r"[\s_.#-]", "", found[1] or found[2] or "") if found else ""


def _check_units(path: Path, header: Mapping[str, str]) -> None:
    lengths, angles = ("x", "y", "height"), ("lat", "lon", "yaw", "pitch", "roll")
    of_angles = (*angles, "omega", "phi", "kappa")
    odd = [header[c] for c in lengths if c in header and _unit(header[c]) in _LENGTHS]
    odd += [header[c] for c in of_angles if c in header and _unit(header[c]) in _GON]
    if odd:
        raise BenchmarkError(
            f"columns in other units: {', '.join(map(repr, odd))}",
            where=path,
            expected="lengths in metres, angles in degrees or radians",
            fix="convert them, and name the columns by the new unit",
        )


def _refuse_other_lenses(path: Path, names: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    for place, name in enumerate(names):
        stated = {row[place].strip() for row in rows} if _plain(name) in _LENS_NAMES else set()
        other = sorted(one for one in stated if one.upper() in _OTHER_LENSES)
        if other:
            raise BenchmarkError(
                f"camera models that are not computed: {', '.join(other)}",
                where=f"{path}, column {name!r}",
                expected="a pinhole camera with k1 k2 p1 p2 k3",
                fix="undistort the photos and give that camera",
            )


def _column(name: str) -> str | None:
    plain = _plain(name)
    for given in (plain, plain.removesuffix(_FOUND)):
        found = next((column for column, known in _NAMES.items() if given in known), None)
        if found is not None:
            return found
    return None


def _columns(path: Path, names: Sequence[str]) -> tuple[dict[str, str], bool]:
    """Return what the file calls each column that is known, and whether it is what was found."""
    given: dict[str, list[str]] = {}
    found: dict[str, list[str]] = {}
    for name in names:
        column = _column(name)
        if column is not None:
            ours = _plain(name) in _NAMES[column]
            (given if ours else found).setdefault(column, []).append(name)
    estimated = {"x", "y", "height"} <= set(found) or {"lat", "lon", "height"} <= set(found)
    if estimated:
        given = {column: value for column, value in given.items() if column not in _POSE} | found
    twice = [" and ".join(map(repr, value)) for value in given.values() if len(value) > 1]
    if twice:
        raise BenchmarkError(
            f"columns that mean the same: {'; '.join(twice)}", where=path, fix="keep one of each"
        )
    header = {column: value[0] for column, value in given.items()}
    _require_columns(path, names, header)
    _check_units(path, header)
    return header, estimated


def _require_columns(path: Path, names: Sequence[str], header: Mapping[str, str]) -> None:
    there = set(header)
    lacking = [name for name in ("image", "height") if name not in there]
    if not ({"lat", "lon"} <= there or {"x", "y"} <= there):
        lacking.append("latitude and longitude, or easting and northing")
    if not ({"yaw", "pitch", "roll"} <= there or {"omega", "phi", "kappa"} <= there):
        lacking.append("yaw, pitch and roll, or omega, phi and kappa")
    if lacking:
        unknown = [name for name in names if name and _column(name) is None]
        near = [nearest(name, unknown) for name in lacking[:1]]
        headings = [name for name in unknown if _plain(name) in _HEADINGS]
        if "yaw" not in there and headings:
            near.append(f" (did you mean yaw by {headings[0]!r}? Rename it)")
        raise BenchmarkError(
            f"lacks {'; '.join(lacking)}{''.join(near)}; its columns are "
            f"{', '.join(names)[:300]!r}",
            where=path,
            expected=_EXPECTED,
        )


def _rows(
    path: Path, lines: Sequence[str], start: int, separator: str | None
) -> list[tuple[int, list[str]]]:
    numbered = enumerate(lines[start:], start + 1)
    try:
        return [(number, _split(line, separator)) for number, line in numbered if line.strip()]
    except csv.Error as error:
        raise BenchmarkError(f"not a table: {error}", where=path) from error


def _check_width(path: Path, number: int, row: Sequence[str], names: Sequence[str]) -> None:
    spare = [value for value in row[len(names) :] if value.strip()]
    if len(row) < len(names) or spare:
        raise BenchmarkError(
            f"has {counted(len(row), 'value')} for {counted(len(names), 'column')}: "
            f"{' '.join(row)[:60]!r}",
            where=f"{path}, line {number}",
            expected=f"{len(names)} values",
            fix="write numbers with a decimal point, and names with blanks in a table that commas "
            "or tabs separate",
        )
