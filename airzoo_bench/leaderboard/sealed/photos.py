"""Photos without metadata, which carry the true pose: EXIF, XMP, notes of the maker, previews.

JPEG and PNG are cut, not encoded again: what is no part of the picture is left out byte for byte,
so that the pixels stay. Kept is what an allow list
names. Another reader, Pillow, then says whether anything is left.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.formats.photos import opened_photo

__all__ = ["Cut", "cuts_of", "is_tiff", "leftovers", "pixels_alone", "refuse_leftovers"]

Cut = tuple[int, int]
"""Where a file is cut: offset and number of bytes."""

_JPEG, _PNG, _TIFF = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n", (b"II*\0", b"MM\0*")
_JPEG_END, _JPEG_SCAN = 0xD9, 0xDA
# Frames (but hierarchical ones), tables of Huffman, arithmetic and quantisation, DNL, DRI.
_JPEG_KEPT = frozenset((*range(0xC0, 0xC4), *range(0xC9, 0xCD), 0xC4, 0xDB, 0xDC, 0xDD))
_JPEG_ALONE = frozenset((0x01, *range(0xD0, 0xD8)))
_PNG_KEPT = frozenset((b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"))
# What Pillow may know of a file that holds a picture alone.
_KNOWN = frozenset(
    (
        *("jfif", "jfif_version", "jfif_unit", "jfif_density", "dpi", "adobe", "adobe_transform"),
        *("progressive", "progression", "transparency", "interlace", "compression"),
        "resolution",
    )
)
_MARKS = (b"Exif\0\0", b"http://ns.adobe.com", b"<x:xmpmeta", b"Photoshop 3.0", b"ICC_PROFILE")
# Tags of TIFF that say how the pixels lie in the file.
_TIFF_KEPT = frozenset(
    (
        *(254, 256, 257, 258, 259, 262, 266, 273, 274, 277, 278, 279, 282, 283, 284, 296),
        *(317, 320, 322, 323, 324, 325, 338, 339, 347, 530, 532),
    )
)


def cuts_of(data: bytes, where: Path) -> list[Cut]:
    """Find what of a JPEG or PNG is no part of the picture."""
    if data.startswith(_PNG):
        parts = _png_parts(data)
    elif data.startswith(_JPEG):
        parts = _jpeg_parts(data)
    else:
        raise _odd(where, "is neither JPEG nor PNG nor TIFF")
    try:
        return _joined([(first, end - first) for first, end, kept in parts if not kept])
    except (IndexError, ValueError) as error:
        raise _odd(where, f"is damaged: {error}") from error


def is_tiff(data: bytes) -> bool:
    """Tell whether a file is a TIFF, which is written anew instead of being cut."""
    return data.startswith(_TIFF)


def pixels_alone(path: Path) -> bytes:
    """Return a TIFF of the first picture of a TIFF, with its pixels and nothing else."""
    from PIL import Image

    with opened_photo(path) as image:
        bare = Image.frombytes(image.mode, image.size, image.tobytes())
        palette = image.getpalette() if image.mode == "P" else None
    if palette is not None:
        bare.putpalette(palette)
    stream = io.BytesIO()
    bare.save(stream, format="TIFF", compression="tiff_deflate")
    return stream.getvalue()


def refuse_leftovers(path: Path) -> None:
    """Refuse a photo that still holds something beside the picture."""
    found = leftovers(path)
    if found:
        raise BenchmarkError(
            f"the photo still holds {first_of(found)}",
            where=path,
            fix="write the photo without metadata (exiftool -all= FILE), and seal again",
        )


def leftovers(path: Path) -> list[str]:
    """Name what a photo holds beside its picture, as another reader than `cuts_of` sees it."""
    data = path.read_bytes()
    found = [repr(mark) for mark in _MARKS if mark in data]
    with opened_photo(path) as image:
        kind = image.format
        found += [f"metadata {key!r}" for key in sorted(map(str, set(image.info) - _KNOWN))]
        found += [f"segment {name}" for name in _odd_segments(image)]
        if kind != "TIFF" and len(image.getexif()):
            found.append("EXIF")
        if kind == "TIFF":
            found += [f"tag {tag}" for tag in sorted(set(image.tag_v2) - _TIFF_KEPT)]  # type: ignore[attr-defined]
        if getattr(image, "n_frames", 1) > 1:
            found.append("more than one picture")
    if (kind == "JPEG" and not data.endswith(b"\xff\xd9")) or (
        kind == "PNG" and not data.endswith(b"IEND\xaeB`\x82")
    ):
        found.append("bytes after its end")
    return found


def _odd_segments(image: Any) -> list[str]:
    """Name segments of applications, as Pillow lists them, that say more than how colours are."""
    plain = {("APP0", 14, b"JFIF\0"), ("APP14", 12, b"Adobe")}
    listed = getattr(image, "applist", [])
    return [name for name, body in listed if (name, len(body), body[:5]) not in plain]


def _jpeg_parts(data: bytes) -> Iterator[tuple[int, int, bool]]:
    """Yield the parts of a JPEG: where they begin and end, and whether they are kept."""
    yield 0, 2, True
    place, code = 2, 0
    while code != _JPEG_END:
        if data[place] != 0xFF:
            raise ValueError(f"no marker at byte {place}")
        begin = place
        while data[place + 1] == 0xFF:  # fill bytes
            place += 1
        code = data[place + 1]
        yield begin, place, False
        end = _jpeg_end(data, place, code)
        yield place, end, _is_kept(code, data[place + 4 : end])
        place = end
    yield place, len(data), False


def _jpeg_end(data: bytes, place: int, code: int) -> int:
    """Return where the part of a marker ends; a scan has its coded data with it."""
    if code == _JPEG_END or code in _JPEG_ALONE:
        return place + 2
    end = place + 2 + int.from_bytes(data[place + 2 : place + 4], "big")
    if end > len(data) or end < place + 4:
        raise ValueError(f"the segment at byte {place} has no end")
    if code != _JPEG_SCAN:
        return end
    while True:
        end = data.index(b"\xff", end)
        if data[end + 1] and not 0xD0 <= data[end + 1] <= 0xD7:
            return end
        end += 2


def _is_kept(code: int, body: bytes) -> bool:
    if code == 0xE0:  # JFIF without a preview
        return len(body) == 14 and body.startswith(b"JFIF\0") and body[12:] == b"\0\0"
    if code == 0xEE:  # how the colours are coded
        return len(body) == 12 and body.startswith(b"Adobe")
    return code in _JPEG_KEPT or code in (_JPEG_END, _JPEG_SCAN)


def _png_parts(data: bytes) -> Iterator[tuple[int, int, bool]]:
    place, kind = len(_PNG), b""
    while kind != b"IEND":
        kind = data[place + 4 : place + 8]
        end = place + 12 + int.from_bytes(data[place : place + 4], "big")
        if len(kind) < 4 or end > len(data):
            raise ValueError(f"the chunk at byte {place} has no end")
        yield place, end, kind in _PNG_KEPT
        place = end
    yield place, len(data), False


def _joined(cuts: list[Cut]) -> list[Cut]:
    """Join parts that touch, and leave out empty ones."""
    joined: list[Cut] = []
    for offset, length in cuts:
        if not length:
            continue
        if joined and sum(joined[-1]) == offset:
            offset, length = joined[-1][0], joined.pop()[1] + length
        joined.append((offset, length))
    return joined


def _odd(where: Path, what: str) -> BenchmarkError:
    return BenchmarkError(
        f"{what}, so that its metadata cannot be taken out",
        where=where,
        expected="a complete JPEG, PNG or TIFF",
        fix="write the photo again as one of these, and prepare the benchmark anew",
    )
