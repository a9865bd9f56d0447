"""The files that a raster's numbers rest on, and the checksum of these.

A virtual raster (VRT) is XML that names the files it is made of. GDAL tells it by its content,
whatever its ending, and reads names of elements and attributes in letters of either case.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from airzoo_bench.core.errors import RasterError
from airzoo_bench.core.files import fingerprint, sha256_of
from airzoo_bench.geometry.rasters import opened

# What GDAL lists next to a raster, and whose content shows in what the raster says of itself.
_SIDE_FILES = (".tfw", ".wld", ".prj", ".xml", ".ovr")
_WITHOUT_SIDE_FILES = {
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
    "GDAL_PAM_ENABLED": "NO",
    "GDAL_GEOREF_SOURCES": "INTERNAL",
}
_SOURCES = ("sourcefilename", "sourcedataset")  # the latter of warped rasters
_PLACE = "relativeToVRT"


def raster_files(path: Path) -> list[Path]:
    """Return a raster's file, then its side files and those a virtual raster is made of, sorted."""
    found = [path]
    for part in found:  # grows: what a virtual raster names may be virtual
        with suppress(RasterError) if part != path else nullcontext(), opened(part) as dataset:
            listed = [Path(name).absolute() for name in dataset.files]
            found += [one for one in listed if one.is_file() and one not in found]
    return [path, *sorted(set(found) - {path, path.absolute()})]


def raster_sha256(path: Path) -> str:
    """Return the SHA-256 of all that the numbers of a raster's first band depend on.

    It is the same wherever the files stand: that of the raster's own file, unless others beside it
    change how this is read, such as a world file, a mask, or an ``.aux.xml`` with a nodata value,
    a scale or a grid. Then it is over the bytes of all that hold numbers, and what the raster says
    of itself because of the rest; statistics and overviews change nothing. That of a virtual
    raster is over its own text and the checksums of the rasters that this names.
    """
    with opened(path) as dataset:
        virtual, stated = dataset.driver == "VRT", _stated(dataset)
        files = [Path(name) for name in dataset.files[1:]]
    if virtual:
        files = [one for one in files if str(one).startswith(f"{path}.")]
    beside = [one for one in files if one.suffix.lower() not in _SIDE_FILES]
    own = fingerprint(_virtual_content(path)) if virtual else sha256_of(path)
    with suppress(RasterError), opened(path, **_WITHOUT_SIDE_FILES) as alone:
        if not beside and stated == _stated(alone):
            return own
    return fingerprint([stated, own, sorted(sha256_of(one) for one in beside)])


def _stated(dataset: Any) -> list[Any]:
    """Return what decides how the numbers of the first band are read, and where they lie."""
    flags = sorted(flag.name for flag in dataset.mask_flag_enums[0])
    crs = dataset.crs.to_string() if dataset.crs else ""
    grid = [dataset.width, dataset.height, *dataset.transform[:6], str(dataset.nodata)]
    scale = [str(dataset.scales[0]), str(dataset.offsets[0]), dataset.units[0] or ""]
    return [*grid, *scale, flags, crs]


def _virtual_content(path: Path) -> str:
    """Return a virtual raster's XML with checksums in place of the names of files."""
    try:
        tree = ET.parse(path)
    except ET.ParseError as error:
        raise RasterError(f"is no XML: {error}", where=path) from error
    found = dict[Path, str]()  # bands name one file each
    for element in source_elements(tree):
        source = source_of(element, path)
        _forget_place(element)
        element.text = found[source] = found.get(source) or raster_sha256(source)
    return ET.canonicalize(ET.tostring(tree.getroot(), "unicode"), strip_text=True)


def source_elements(tree: ET.ElementTree[ET.Element]) -> Iterator[ET.Element]:
    """Yield the elements of a virtual raster that name files."""
    yield from (one for one in tree.iter() if one.tag.lower() in _SOURCES)


def source_of(element: ET.Element, path: Path) -> Path:
    """Return the file that an element of the virtual raster at `path` names."""
    return path.parent / (element.text or "")


def place_source(element: ET.Element, name: str) -> None:
    """Have an element name another file, relative to the folder of the virtual raster."""
    _forget_place(element)
    element.text = name
    element.set(_PLACE, "1")


def _forget_place(element: ET.Element) -> None:
    for name in [one for one in element.attrib if one.lower() == _PLACE.lower()]:
        del element.attrib[name]
