"""Photos without metadata: they lose all that is no picture, and no pixel."""

from __future__ import annotations

import struct
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, PngImagePlugin

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.datasets.metadata import bare_photo

SECRET = b"lat 47.123456 lon 8.654321"
XMP = b'http://ns.adobe.com/xap/1.0/\0<x:xmpmeta drone-dji:GpsLatitude="' + SECRET + b'"/>'
EXIF = b"Exif\0\0II*\0\x08\0\0\0\0\0" + SECRET


def photo(kind: str = "JPEG", mode: str = "RGB", **options: Any) -> bytes:
    grey = np.random.default_rng(5).integers(0, 255, (24, 40)).astype(np.uint8)
    stream, image = BytesIO(), Image.fromarray(np.kron(grey, np.ones((8, 8), np.uint8)))
    image.convert(mode).save(stream, kind, **options)
    return stream.getvalue()


def png() -> bytes:
    notes = PngImagePlugin.PngInfo()
    notes.add_text("c", SECRET.decode())
    notes.add_itxt("i", SECRET.decode())
    notes.add_text("z", SECRET.decode(), zip=True)
    return photo("PNG", pnginfo=notes, dpi=(72, 72), icc_profile=SECRET, exif=EXIF)


def segment(code: int, body: bytes) -> bytes:
    return bytes((0xFF, code)) + struct.pack(">H", len(body) + 2) + body


def with_segments(data: bytes, *segments: bytes) -> bytes:
    return data[:2] + b"".join(segments) + data[2:]


PREVIEW = segment(0xE0, b"JFIF\0\x01\x01\0\0\x01\0\x01\x01\x01" + SECRET[:3])
ZIP, A_XMP = b"PK\x03\x04" + SECRET, segment(0xE1, XMP)
PHOTOS = {
    "exif": with_segments(photo(), segment(0xE1, EXIF)),
    "icc": photo(icc_profile=SECRET * 9000),
    "comment": with_segments(photo(), b"\xff" * 7 + segment(0xFE, SECRET)),
    "applications": with_segments(photo(), *(segment(c, SECRET) for c in range(0xE0, 0xF0))),
    "previews": with_segments(photo(), PREVIEW, segment(0xE0, b"JFXX\0\x10" + photo())),
    "a second picture": photo() + with_segments(photo(), A_XMP) + ZIP,
    "restarts": with_segments(photo(restart_marker_blocks=1), A_XMP),
    "grey": with_segments(photo(mode="L"), A_XMP),
    "four colours": with_segments(photo(mode="CMYK"), A_XMP),
    "between scans": photo(progressive=True).replace(
        b"\xff\xda", segment(0xE2, SECRET) + b"\xff\xda"
    ),
    "PNG": png() + ZIP,
}


@pytest.mark.parametrize("name", PHOTOS)
def test_nothing_but_the_picture_is_left(name: str) -> None:
    after = bare_photo(before := PHOTOS[name], Path("photo"))
    assert after != before
    for secret in (SECRET, b"Exif", b"xmp", b"ICC_PROFILE", b"JFXX", b"PK\x03\x04", b"tEXt"):
        assert secret not in after
    with Image.open(BytesIO(before)) as one, Image.open(BytesIO(after)) as other:
        assert other.mode == one.mode
        assert np.array_equal(np.asarray(one), np.asarray(other))


def test_what_cannot_be_freed_of_metadata_is_refused() -> None:
    made = photo()
    damaged = [b"", b"GIF89a", b"II*\0", made[:-2], made[:300], made[:20] + b"\0" + made[20:]]
    for data in [*damaged, png()[:-12]]:
        with pytest.raises(BenchmarkError, match="metadata cannot be taken out"):
            bare_photo(data, Path("photo.jpg"))


_SEGMENTS = st.lists(st.tuples(st.sampled_from(range(0xE0, 0xFF)), st.binary(max_size=40)))


@given(_SEGMENTS, st.binary(max_size=400))
def test_any_segments_go_and_any_bytes_are_cut_or_refused(segments, data) -> None:
    made = [segment(code, body) for code, body in segments if code != 0xEE]
    assert bare_photo(with_segments(photo(), *made) + data, Path("photo")) == photo()
    for head in (b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"):
        with suppress(BenchmarkError):
            assert bare_photo(head + data, Path("photo")).startswith(head[:2])
