"""Virtual rasters (VRT): XML that says of which files a raster is made, and how."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

from airzoo_bench.core.errors import RasterError

__all__ = ["content_of", "source_elements"]

_SOURCES = ("SourceFilename", "SourceDataset")  # the latter of warped rasters
_PLACE = "relativeToVRT"


def source_elements(tree: ET.ElementTree[ET.Element]) -> Iterator[ET.Element]:
    """Yield the elements whose texts name files.

    Parameters
    ----------
    tree : ElementTree
        Of a virtual raster.

    Yields
    ------
    Element
        Its text may be set to another name.
    """
    yield from (one for one in tree.iter() if one.tag in _SOURCES)


def content_of(path: Path, checksum: Callable[[Path], str]) -> str:
    """Return a virtual raster's XML with the checksums of files in place of their names.

    It is the same wherever raster and files stand, and another where a file is placed elsewhere in
    the raster, before or behind another, or with other settings.

    Parameters
    ----------
    path : Path
        Of the virtual raster.
    checksum : callable
        Of a file.

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
    for element in source_elements(tree):
        source = path.parent / (element.text or "")
        if not source.is_file():
            raise RasterError(
                f"is made of a file that is not there: {str(element.text)[:200]}",
                where=path,
                fix="put the file back, or make one GeoTIFF of all (gdal_translate)",
            )
        element.text = checksum(source)
        element.attrib.pop(_PLACE, None)
    return ET.canonicalize(ET.tostring(tree.getroot(), "unicode"), strip_text=True)
