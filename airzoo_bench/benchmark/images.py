"""Pictures of a benchmark: photos and tiles, read small enough to work with."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from PIL.Image import Resampling

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.formats.photos import open_photo
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.storage.urls import ensure_file

_ORIENTATION_TAG = 0x0112
_FIX = "put the photos back where benchmark.toml says, or prepare with --copy"


def photo_size(path: Path) -> tuple[int, int]:
    """Read width and height in pixels, as stored, from a photo's header."""
    with open_photo(ensure_file(path)) as image:
        orientation = image.getexif().get(_ORIENTATION_TAG)
        size = image.size
    if orientation in range(2, 9):  # other values mean nothing, and some cameras write 0
        raise BenchmarkError(
            f"is to be shown turned (EXIF orientation {orientation})",
            where=path,
            expected="orientation 1: a camera matrix belongs to the pixels as they are stored",
            fix="turn the pixels (jpegtran) or clear the tag (exiftool -Orientation=1 -n)",
        )
    return size


def read_grey(path: Path, long_side: int) -> NDArray[np.uint8]:
    """Read a photo as grey (height, width), made smaller so that its long side fits."""
    return _read(path, long_side, "L")


def read_rgb_photo(path: Path, long_side: int) -> NDArray[np.uint8]:
    """Read a photo in colour (height, width, 3), made smaller so that its long side fits."""
    return _read(path, long_side, "RGB")


def _read(path: Path, long_side: int, mode: str) -> NDArray[np.uint8]:
    with open_photo(ensure_file(path), _FIX) as image:
        scale = min(1.0, long_side / max(image.size))
        size = (max(1, round(image.width * scale)), max(1, round(image.height * scale)))
        # libjpeg skips what is thrown away. It rounds sizes up, so that the last row and
        # column may reach beyond the photo: the box is the photo's part of what it gives.
        reduced = image.draft(mode, size)
        box = reduced[1] if reduced else None
        return np.asarray(image.convert(mode).resize(size, Resampling.LANCZOS, box))


def read_tile(dom: Path, tile: pd.Series[Any]) -> NDArray[np.uint8]:
    """Read one tile (height, width, 3) from its window of the map."""
    window = (int(tile["x"]), int(tile["y"]), int(tile["width"]), int(tile["height"]))
    return read_rgb(dom, window)


# --- photos without metadata: cut, not encoded again ---

_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"
_END, _SCAN, _JFIF, _ADOBE = 0xD9, 0xDA, 0xE0, 0xEE
# Frames (except hierarchical ones), tables of Huffman, arithmetic and quantisation, DNL, DRI.
_JPEG_KEPT = frozenset((*range(0xC0, 0xC5), *range(0xC9, 0xCD), 0xDB, 0xDC, 0xDD, _END, _SCAN))
_JPEG_ALONE = frozenset((0x01, *range(0xD0, 0xD8), _END))
# A scan, with its coded data: up to a marker that is no stuffed byte and no restart.
_CODED = re.compile(rb"(?:[^\xff]|\xff[\x00\xd0-\xd7])*+", re.DOTALL)
_PNG_KEPT = frozenset((b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"))


def bare_photo(data: bytes, where: Path) -> bytes:
    """Return the parts of a JPEG or PNG that make the picture."""
    try:
        for mark, parts in ((_JPEG, _jpeg_parts), (_PNG, _png_parts)):
            if data.startswith(mark):
                return b"".join(parts(data))
    except (IndexError, ValueError):
        pass
    what, fix = "its metadata cannot be taken out", "write it again, and prepare the benchmark anew"
    raise BenchmarkError(what, where=where, expected="a complete JPEG or PNG", fix=fix)


def _jpeg_parts(data: bytes) -> Iterator[bytes]:
    """Yield the parts that stay; a scan has its coded data with it."""
    yield data[:2]
    place, code = 2, 0
    while code != _END:
        if data[place] != 0xFF:
            raise ValueError("no marker")
        while data[place + 1] == 0xFF:  # fill bytes
            place += 1
        code, end = data[place + 1], place + 2
        if code not in _JPEG_ALONE:
            end += int.from_bytes(data[end : end + 2], "big")
            if end > len(data) or end < place + 4:
                raise ValueError("a segment without an end")
        body = data[place + 4 : end]
        # JFIF without a preview, and how the colours are coded.
        plain = len(body) == 14 and body.startswith(b"JFIF\0") and body[12:] == b"\0\0"
        plain = plain if code == _JFIF else len(body) == 12 and body.startswith(b"Adobe")
        if code == _SCAN and (coded := _CODED.match(data, end)):
            end = coded.end()
        if code in _JPEG_KEPT or (code in (_JFIF, _ADOBE) and plain):
            yield data[place:end]
        place = end


def _png_parts(data: bytes) -> Iterator[bytes]:
    yield _PNG
    place, kind = len(_PNG), b""
    while kind != b"IEND":
        kind = data[place + 4 : place + 8]
        end = place + 12 + int.from_bytes(data[place : place + 4], "big")
        if len(kind) < 4 or end > len(data):
            raise ValueError("a chunk without an end")
        if kind in _PNG_KEPT:
            yield data[place:end]
        place = end
