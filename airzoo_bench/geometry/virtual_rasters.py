"""Virtual rasters (VRT): XML that says of which files a raster is made, and how.

GDAL tells them by their content, whatever their ending, and reads names of elements and attributes
in letters of either case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from airzoo_bench.core.errors import RasterError

__all__ = ["content_of", "is_virtual", "place_source", "source_elements", "source_of"]

_SOURCES = ("sourcefilename", "sourcedataset")  # the latter of warped rasters
_PLACE = "relativeToVRT"
_RECTANGLES = "srcrect", "dstrect"
_SIDES = "xsize", "ysize"


def is_virtual(dataset: Any) -> bool:
    """Tell whether an open raster is a virtual one.

    Parameters
    ----------
    dataset : Any
        Rasterio's.

    Returns
    -------
    bool
        True for a VRT.
    """
    return bool(dataset.driver == "VRT")


def source_elements(tree: ET.ElementTree[ET.Element]) -> Iterator[ET.Element]:
    """Yield the elements whose texts name files.

    Parameters
    ----------
    tree : ElementTree
        Of a virtual raster.

    Yields
    ------
    Element
        See `source_of` and `place_source`.
    """
    yield from (one for one in tree.iter() if one.tag.lower() in _SOURCES)


def source_of(element: ET.Element, path: Path) -> Path:
    """Return the file that one of the `source_elements` of a virtual raster names.

    Parameters
    ----------
    element : Element
        Its text is the name.
    path : Path
        Of the virtual raster.

    Returns
    -------
    Path
        A name that is no whole path begins in the virtual raster's folder.

    Raises
    ------
    RasterError
        It is another one for each folder in which a program is started.
    """
    named = Path(element.text or "")
    places = {value for name, value in element.items() if name.lower() == _PLACE.lower()}
    if places != {"1"} and not named.is_absolute():
        raise RasterError(
            f"is made of a file whose folder it does not say: {str(named)[:200]}",
            where=path,
            expected=f'{_PLACE}="1" at names that begin where the raster lies',
            fix="write it again (gdalbuildvrt), or make one GeoTIFF of all (gdal_translate)",
        )
    return path.parent / named


def place_source(element: ET.Element, name: str) -> None:
    """Have one of the `source_elements` name another file.

    Parameters
    ----------
    element : Element
        It is changed.
    name : str
        Relative to the folder of the virtual raster.
    """
    _forget_place(element)
    element.text = name
    element.set(_PLACE, "1")


def _forget_place(element: ET.Element) -> None:
    for name in [one for one in element.attrib if one.lower() == _PLACE.lower()]:
        del element.attrib[name]


def content_of(path: Path, checksum: Callable[[Path, bool], str]) -> str:
    """Return a virtual raster's XML with the checksums of files in place of their names.

    It is the same wherever raster and files stand, and another where a file is placed elsewhere in
    the raster, before or behind another, or with other settings.

    Parameters
    ----------
    path : Path
        Of the virtual raster.
    checksum : callable
        Of a file, and of whether it is read at another size than its own, from its overviews.

    Returns
    -------
    str
        Canonical XML.

    Raises
    ------
    RasterError
        It is no XML, or a file that it names is not there.
    """
    try:
        tree = ET.parse(path)
    except ET.ParseError as error:
        raise RasterError(f"is no XML: {error}", where=path) from error
    plain = {id(one) for source in tree.iter() if _at_its_size(source) for one in source}
    for element in source_elements(tree):
        source = source_of(element, path)
        if not source.is_file():
            raise RasterError(
                f"is made of a file that is not there: {str(element.text)[:200]}",
                where=path,
                fix="put the file back, or make one GeoTIFF of all (gdal_translate)",
            )
        _forget_place(element)
        element.text = checksum(source, id(element) not in plain)
    return ET.canonicalize(ET.tostring(tree.getroot(), "unicode"), strip_text=True)


def _at_its_size(element: ET.Element) -> bool:
    """Tell whether an element is a source of a band that is placed pixel by pixel."""
    parts = {one.tag.lower(): one for one in element}
    given = [_sides(parts[name]) for name in _RECTANGLES if name in parts]
    # Without rectangles a source is placed at the corner, as it is.
    return element.tag.lower().endswith("source") and len({*given}) <= 1 and None not in given


def _sides(rectangle: ET.Element) -> tuple[float, ...] | None:
    given = {name.lower(): value for name, value in rectangle.items()}
    try:
        return tuple(float(given[name]) for name in _SIDES)
    except (KeyError, ValueError):
        return None
