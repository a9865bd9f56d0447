"""Photos without metadata, which carry the true pose: EXIF, XMP, notes of the maker, previews.

JPEG and PNG are cut, not encoded again: only parts of an allow list stay, so that pixels are the
same to the last bit. Another reader, Pillow, then says whether anything is left.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.formats.photos import opened_photo

__all__ = ["bare_photo", "leftovers", "write_bare_photo"]

_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"
_END, _SCAN, _JFIF, _ADOBE = 0xD9, 0xDA, 0xE0, 0xEE
# Frames (except hierarchical ones), tables of Huffman, arithmetic and quantisation, DNL, DRI.
_JPEG_KEPT = frozenset((*range(0xC0, 0xC5), *range(0xC9, 0xCD), 0xDB, 0xDC, 0xDD, _END, _SCAN))
_JPEG_ALONE = frozenset((0x01, *range(0xD0, 0xD8), _END))
_PNG_KEPT = frozenset((b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"))
# Pillow may know these of a file that holds a picture alone.
_KNOWN = {"jfif", "jfif_version", "jfif_unit", "jfif_density", "dpi", "adobe", "adobe_transform"}
_KNOWN |= {"progressive", "progression", "transparency", "interlace"}
_MARKS = (b"Exif\0\0", b"http://ns.adobe.com", b"<x:xmpmeta", b"Photoshop 3.0", b"ICC_PROFILE")
_ENDS = {"JPEG": b"\xff\xd9", "PNG": b"IEND\xaeB`\x82"}
_PLAIN_SEGMENTS = {("APP0", 14, b"JFIF\0"), ("APP14", 12, b"Adobe")}


def write_bare_photo(source: Path, place: Path) -> None:
    """Write a photo without metadata, and refuse one that still holds some."""
    place.write_bytes(bare_photo(source.read_bytes(), source))
    if found := leftovers(place):
        fix = "write the photo without metadata (exiftool -all= FILE), and seal again"
        raise BenchmarkError(f"the photo still holds {first_of(found)}", where=source, fix=fix)


def bare_photo(data: bytes, where: Path) -> bytes:
    """Return the parts of a JPEG or PNG that make the picture."""
    parts = {_PNG: _png_parts, _JPEG: _jpeg_parts}
    kind = next((kind for kind in parts if data.startswith(kind)), None)
    what = "is neither JPEG nor PNG"
    try:
        if kind is not None:
            return b"".join(data[first:end] for first, end in parts[kind](data))
    except (IndexError, ValueError) as error:
        what = f"is damaged: {error}"
    raise BenchmarkError(
        f"{what}, so that its metadata cannot be taken out",
        where=where,
        expected="a complete JPEG or PNG",
        fix="write the photo again as one of these, and prepare the benchmark anew",
    )


def leftovers(path: Path) -> list[str]:
    """Name what a photo holds beside its picture, as another reader sees it."""
    data = path.read_bytes()
    found = [repr(mark) for mark in _MARKS if mark in data]
    with opened_photo(path) as image:
        found += [f"metadata {key!r}" for key in sorted(map(str, set(image.info) - _KNOWN))]
        segments = getattr(image, "applist", [])
        odd = [n for n, body in segments if (n, len(body), body[:5]) not in _PLAIN_SEGMENTS]
        found += [f"segment {name}" for name in odd]
        found += ["EXIF"] * bool(len(image.getexif()))
        found += ["more than one picture"] * (getattr(image, "n_frames", 1) > 1)
        found += ["bytes after its end"] * (not data.endswith(_ENDS.get(image.format or "", b"")))
    return found


def _jpeg_parts(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield the beginnings and ends of the parts that stay; a scan has its coded data with it."""
    yield 0, 2
    place, code = 2, 0
    while code != _END:
        if data[place] != 0xFF:
            raise ValueError(f"no marker at byte {place}")
        while data[place + 1] == 0xFF:  # fill bytes
            place += 1
        code, end = data[place + 1], place + 2
        if code not in _JPEG_ALONE:
            end += int.from_bytes(data[end : end + 2], "big")
            if end > len(data) or end < place + 4:
                raise ValueError(f"the segment at byte {place} has no end")
        while code == _SCAN:
            end = data.index(b"\xff", end)
            if data[end + 1] and not 0xD0 <= data[end + 1] <= 0xD7:
                break
            end += 2
        if code in _JPEG_KEPT or _is_plain(code, data[place + 4 : end]):
            yield place, end
        place = end


def _is_plain(code: int, body: bytes) -> bool:
    """Whether a segment is JFIF without a preview, or says how the colours are coded."""
    if code == _JFIF:
        return len(body) == 14 and body.startswith(b"JFIF\0") and body[12:] == b"\0\0"
    return code == _ADOBE and len(body) == 12 and body.startswith(b"Adobe")


def _png_parts(data: bytes) -> Iterator[tuple[int, int]]:
    yield 0, len(_PNG)
    place, kind = len(_PNG), b""
    while kind != b"IEND":
        kind = data[place + 4 : place + 8]
        end = place + 12 + int.from_bytes(data[place : place + 4], "big")
        if len(kind) < 4 or end > len(data):
            raise ValueError(f"the chunk at byte {place} has no end")
        if kind in _PNG_KEPT:
            yield place, end
        place = end
