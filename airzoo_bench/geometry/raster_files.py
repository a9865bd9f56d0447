"""The files that a raster's numbers rest on, and the checksum of these."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import RasterError
from airzoo_bench.core.files import fingerprint, sha256_of
from airzoo_bench.geometry.rasters import opened
from airzoo_bench.geometry.virtual_rasters import content_of, is_virtual
from airzoo_bench.storage.rasters import Pointer, pointed, pointed_sha256, pointer_at

__all__ = ["raster_files", "raster_sha256"]

_OVERVIEWS = ".ovr"
# What GDAL lists next to a raster, and whose content shows in what the raster says of itself.
_SIDE_FILES = (".tfw", ".wld", ".prj", ".xml", _OVERVIEWS)
_WITHOUT_SIDE_FILES = {
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
    "GDAL_PAM_ENABLED": "NO",
    "GDAL_GEOREF_SOURCES": "INTERNAL",
}


def raster_files(path: Path) -> list[Path]:
    """Return the files of a raster that its content rests on, its own first.

    These are world files and other side files, and what a virtual raster is made of.

    Parameters
    ----------
    path : Path
        Of the raster.

    Returns
    -------
    list of Path
        The others are sorted.

    Raises
    ------
    RasterError
        It cannot be read.
    """
    found, waiting = [path], [path]
    while waiting:
        with opened(waiting.pop()) as dataset:
            parts = [Path(name).absolute() for name in dataset.files]
        more = [part for part in parts if part not in found and part.is_file()]
        waiting += [part for part in more if _is_virtual(part)]
        found += more
    return [path, *sorted(set(found) - {path, path.absolute()})]


def _is_virtual(path: Path) -> bool:
    try:
        with opened(path) as dataset:
            return is_virtual(dataset)
    except RasterError:  # a side file
        return False


def raster_sha256(path: Path) -> str:
    """Return the SHA-256 of what the numbers of a raster's first band rest on.

    It is the same wherever the files stand: that of the raster's own file, unless others beside it
    change how this is read, such as a world file, a mask, or an ``.aux.xml`` with a nodata value,
    a scale or a grid. Then it is over the bytes of all that hold numbers, and what the raster says
    of itself because of the rest; statistics and overviews change nothing.

    Of a virtual raster (VRT) it is over its own text and the checksums of the rasters that this
    names; overviews of these count where it does not take them pixel by pixel, since GDAL then
    reads its numbers from them.

    Parameters
    ----------
    path : Path
        Also of a mirror, where the raster lies at a URL.

    Returns
    -------
    str
        In hexadecimal.

    Raises
    ------
    RasterError
        It cannot be read, or lies at a URL and rests on more than one file there.
    """
    return _Sums().of(path, shrunk=False)


class _Sums:
    """The checksums of a raster and of all it is made of, each found once."""

    def __init__(self) -> None:
        self._known: dict[tuple[Path, bool], str | None] = {}  # None while they are under way

    def of(self, path: Path, shrunk: bool) -> str:
        """Return a raster's; `shrunk` where it is read at another size than its own."""
        place = path.resolve(), shrunk
        found = self._known[place] if place in self._known else self._computed(path, shrunk)
        if found is None:
            raise RasterError("a virtual raster that is made of itself", where=path)
        self._known[place] = found
        return found

    def _computed(self, path: Path, shrunk: bool) -> str:
        self._known[path.resolve(), shrunk] = None
        pointer = pointer_at(pointed(path))
        with opened(path) as dataset:
            virtual, stated = is_virtual(dataset), _stated(dataset)
            files = [Path(name) for name in dataset.files[1:]]
        if virtual:
            own = self._of_virtual(path, shrunk, pointer)
        else:
            own = sha256_of(path) if pointer is None else pointed_sha256(path, pointer)
        beside = _holding_numbers(path, files, virtual=virtual, shrunk=shrunk)
        if beside and pointer is not None:
            raise RasterError(
                f"at a URL, with files beside it that nobody can hold to a checksum: "
                f"{beside[0].name}",
                where=path,
                expected="one file that holds all of it",
                fix="put masks into the file (gdal_translate) before `prepare`, and upload that",
            )
        if not beside and stated == _stated_alone(path):
            return own
        return fingerprint([stated, own, sorted(sha256_of(one) for one in beside)])

    def _of_virtual(self, path: Path, shrunk: bool, pointer: Pointer | None) -> str:
        if pointer is not None:
            raise RasterError(
                "a virtual raster at a URL, whose sources nobody can hold to a checksum",
                where=path,
                fix="make one GeoTIFF of it (gdal_translate -of COG), and prepare with that",
            )
        return fingerprint(content_of(path, lambda source, less: self.of(source, shrunk or less)))


def _stated(dataset: Any) -> list[Any]:
    """Return what decides how the numbers of the first band are read, and where they lie."""
    flags = sorted(flag.name for flag in dataset.mask_flag_enums[0])
    crs = dataset.crs.to_string() if dataset.crs else ""
    grid = [dataset.width, dataset.height, *dataset.transform[:6], str(dataset.nodata)]
    scale = [str(dataset.scales[0]), str(dataset.offsets[0]), dataset.units[0] or ""]
    return [*grid, *scale, flags, crs]


def _stated_alone(path: Path) -> list[Any] | None:
    """Return what a raster's own file states; None where it cannot be read without the others."""
    try:
        with opened(path, **_WITHOUT_SIDE_FILES) as dataset:
            return _stated(dataset)
    except RasterError:
        return None


def _holding_numbers(path: Path, files: list[Path], *, virtual: bool, shrunk: bool) -> list[Path]:
    """Return the files beside a raster that hold numbers, without those it is made of."""
    left_out = [ending for ending in _SIDE_FILES if not (shrunk and ending == _OVERVIEWS)]
    parts = [one for one in files if not virtual or str(one).startswith(f"{path}.")]
    return [one for one in parts if one.suffix.lower() not in left_out]
