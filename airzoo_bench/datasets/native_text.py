"""Texts of benchmarks: UTF-8 or GB18030, and what is found in place of one."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError

__all__ = ["read_native_text"]

_LIMIT_BYTES = 64 << 20
_ENCODINGS = ("utf-8-sig", "gb18030")
_STARTS = {
    b"\xff\xfe": "UTF-16 text",
    b"\xfe\xff": "UTF-16 text",
    b"PK\x03\x04": "a zip archive or an Excel workbook",
    b"version https://git-lfs": "a Git LFS pointer, not the file itself",
    b"<!doctype": "a web page",
    b"<html": "a web page",
}
_FIXES = {
    "UTF-16 text": "save it as CSV in UTF-8",
    "a zip archive or an Excel workbook": "unpack it, or save the sheet as CSV in UTF-8",
}


def read_native_text(path: Path, limit_bytes: int = _LIMIT_BYTES) -> str:
    """Read a text in UTF-8, with or without a byte-order mark, or in GB18030."""
    if path.is_dir():
        raise BenchmarkError("a folder, not a table", where=path)
    if not path.is_file():
        raise BenchmarkError("no such table", where=path)
    if path.stat().st_size > limit_bytes:
        raise BenchmarkError(
            "too large for a table", where=path, expected=f"at most {limit_bytes:,} bytes"
        )
    content = path.read_bytes()
    _check_kind(path, content)
    for encoding in _ENCODINGS:
        try:
            return content.decode(encoding)
        except UnicodeDecodeError as error:
            failure = error
    line = content.count(b"\n", 0, failure.start) + 1
    raise BenchmarkError(
        f"not text: byte {failure.start} is neither UTF-8 nor GB18030",
        where=f"{path}, line {line}",
        fix="save the table in UTF-8, or download it again",
    )


def _check_kind(path: Path, content: bytes) -> None:
    start = content[:64].lstrip().lower()
    kinds = [kind for mark, kind in _STARTS.items() if start.startswith(mark.lower())]
    if not kinds and b"\0" in content:
        kinds = ["not text: it holds zero bytes, as a file does that was not downloaded whole"]
    if kinds:
        raise BenchmarkError(
            f"is {kinds[0]}",
            where=path,
            expected="a table as text",
            fix=_FIXES.get(kinds[0], "download the file again"),
        )
