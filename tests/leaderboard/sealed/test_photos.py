"""Photos lose all that is no picture, and no pixel."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, PngImagePlugin

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.leaderboard.sealing import bare_photo, leftovers, write_bare_photo

SECRET = b"lat 47.123456 lon 8.654321"
XMP = b'http://ns.adobe.com/xap/1.0/\0<x:xmpmeta drone-dji:GpsLatitude="' + SECRET + b'"/>'
EXIF = b"Exif\0\0II*\0\x08\0\0\0\0\0" + SECRET


def picture(mode: str = "RGB") -> Image.Image:
    random = np.random.default_rng(5)
    grey = random.integers(0, 255, (24, 40)).astype(np.uint8)
    image = Image.fromarray(np.kron(grey, np.ones((8, 8), np.uint8)))
    return image.convert(mode)


def jpeg(mode: str = "RGB", **options: Any) -> bytes:
    stream = io.BytesIO()
    picture(mode).save(stream, "JPEG", **options)
    return stream.getvalue()


def png() -> bytes:
    stream = io.BytesIO()
    notes = PngImagePlugin.PngInfo()
    notes.add_text("c", SECRET.decode())
    notes.add_itxt("i", SECRET.decode())
    notes.add_text("z", SECRET.decode(), zip=True)
    picture().save(stream, "PNG", pnginfo=notes, dpi=(72, 72), icc_profile=SECRET)
    return stream.getvalue()


def segment(code: int, body: bytes) -> bytes:
    return bytes((0xFF, code)) + struct.pack(">H", len(body) + 2) + body


def with_segments(data: bytes, *segments: bytes) -> bytes:
    return data[:2] + b"".join(segments) + data[2:]


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


APPS = [segment(code, SECRET) for code in range(0xE0, 0xF0)]
PREVIEW = segment(0xE0, b"JFIF\0\x01\x01\0\0\x01\0\x01\x01\x01" + SECRET[:3])
JFXX = segment(0xE0, b"JFXX\0\x10" + jpeg())
ZIP = b"PK\x03\x04" + SECRET
JPEGS: dict[str, Callable[[], bytes]] = {
    "exif": lambda: with_segments(jpeg(), segment(0xE1, EXIF)),
    "xmp": lambda: with_segments(jpeg(), segment(0xE1, XMP)),
    "iptc": lambda: with_segments(jpeg(), segment(0xED, b"Photoshop 3.0\0" + SECRET)),
    "icc": lambda: jpeg(icc_profile=SECRET * 9000),
    "comment": lambda: with_segments(jpeg(), segment(0xFE, SECRET)),
    "every application": lambda: with_segments(jpeg(), *APPS),
    "previews": lambda: with_segments(jpeg(), PREVIEW, JFXX),
    "fill bytes": lambda: with_segments(jpeg(), b"\xff" * 7 + segment(0xFE, SECRET)),
    "after its end": lambda: jpeg() + ZIP,
    "a second picture": lambda: jpeg() + with_segments(jpeg(), segment(0xE1, XMP)),
    "progressive": lambda: with_segments(jpeg(progressive=True), segment(0xE1, XMP)),
    "restarts": lambda: with_segments(jpeg(restart_marker_blocks=1), segment(0xE1, XMP)),
    "grey": lambda: with_segments(jpeg("L"), segment(0xE1, XMP)),
    "four colours": lambda: with_segments(jpeg("CMYK"), segment(0xE1, XMP)),
    "between scans": lambda: jpeg(progressive=True).replace(
        b"\xff\xda", segment(0xE2, SECRET) + b"\xff\xda"
    ),
}
PNGS: dict[str, Callable[[], bytes]] = {
    "texts and profile": png,
    "exif chunk": lambda: png()[:33] + chunk(b"eXIf", EXIF) + png()[33:],
    "unknown chunk": lambda: png()[:33] + chunk(b"prVt", SECRET) + png()[33:],
    "after its end": lambda: png() + ZIP,
}


@pytest.mark.parametrize("made", [*JPEGS.values(), *PNGS.values()], ids=[*JPEGS, *PNGS])
def test_nothing_but_the_picture_is_left(made: Callable[[], bytes], tmp_path: Path) -> None:
    before, after = tmp_path / "before", tmp_path / "after"
    before.write_bytes(made())
    assert leftovers(before), "the other reader does not see what there was"
    write_bare_photo(before, after)
    for secret in (SECRET, b"Exif", b"xmp", b"ICC_PROFILE", b"JFXX", b"PK\x03\x04"):
        assert secret not in after.read_bytes()
    with Image.open(before) as one, Image.open(after) as other:
        assert other.mode == one.mode
        assert np.array_equal(np.asarray(one), np.asarray(other))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"GIF89a",
        b"II*\0",
        jpeg()[:-2],
        jpeg()[:300],
        jpeg()[:20] + b"\0" + jpeg()[20:],
        png()[:-12],
    ],
    ids=["empty", "gif", "tiff", "no end", "cut off", "no marker", "png without end"],
)
def test_what_cannot_be_freed_of_metadata_is_refused(data: bytes) -> None:
    with pytest.raises(BenchmarkError, match="metadata cannot be taken out"):
        bare_photo(data, Path("photo.jpg"))


def test_what_is_left_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(with_segments(jpeg(), segment(0xE1, XMP)))
    monkeypatch.setattr("airzoo_bench.leaderboard.sealing.bare_photo", lambda data, where: data)
    with pytest.raises(BenchmarkError, match="the photo still holds"):
        write_bare_photo(path, tmp_path / "b.jpg")


@given(st.lists(st.tuples(st.sampled_from(range(0xE0, 0xFF)), st.binary(max_size=40))), st.binary())
def test_any_segments_go_and_the_picture_stays(
    segments: list[tuple[int, bytes]], after: bytes
) -> None:
    plain = jpeg()
    made = [segment(code, body) for code, body in segments if code != 0xEE]
    assert bare_photo(with_segments(plain, *made) + after, Path("photo")) == plain


@given(st.binary(max_size=400))
def test_any_bytes_are_cut_or_refused(data: bytes) -> None:
    for head in (b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"):
        with suppress(BenchmarkError):
            assert bare_photo(head + data, Path("photo")).startswith(head[:2])
