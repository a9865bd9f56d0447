"""Files that builds keep for the next one, with checksums: what is damaged is as if not there."""

from __future__ import annotations

import hashlib
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.files import atomic_write
from airzoo_bench.geometry.arrays import Floats

__all__ = ["keep_json", "keep_rows", "kept_json", "kept_row"]

_CRC_BYTES = 4


def keep_json(file: Path, value: object) -> None:
    """Write a value as JSON, below its hash."""
    content = json.dumps(value).encode()
    with atomic_write(file) as stream:
        stream.write(_digest(content) + b"\n" + content)


def kept_json(file: Path) -> Any:
    """Return a value that `keep_json` wrote; None where it is missing or damaged."""
    try:
        digest, _, content = file.read_bytes().partition(b"\n")
    except OSError:
        return None
    return json.loads(content) if digest == _digest(content) else None


def keep_rows(file: Path, rows: Floats) -> None:
    """Write the rows of an array (V, N), each with its checksum: one is read without the others."""
    with atomic_write(file) as stream:
        for row in rows:
            content = row.astype("<f8").tobytes()
            stream.write(content + zlib.crc32(content).to_bytes(_CRC_BYTES, "big"))


def kept_row(file: Path, place: int, count: int) -> Floats | None:
    """Return a row of `count` numbers that `keep_rows` wrote; None where it is damaged."""
    size = 8 * count
    try:
        with file.open("rb", buffering=0) as stream:
            stream.seek(place * (size + _CRC_BYTES))
            content = stream.read(size + _CRC_BYTES)
    except OSError:
        return None
    numbers, checksum = content[:size], content[size:]
    whole = checksum == zlib.crc32(numbers).to_bytes(_CRC_BYTES, "big")
    return np.frombuffer(numbers, "<f8") if whole else None


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()
