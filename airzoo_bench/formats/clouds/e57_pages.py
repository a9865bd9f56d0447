"""Pages of E57 files: 4 bytes of checksum end each, and are no part of what lies in them.

The checksum is CRC-32C (Castagnoli; RFC 3720, appendix B.4), its highest byte first.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import FIX_COPY, refusal

__all__ = ["Pages", "crc32c", "damaged"]

_CHECKSUM = 4
_POLYNOMIAL = 0x82F63B78  # reflected
_ALL_ONES = 0xFFFFFFFF
_PAGES_AT_ONCE = 256

U32 = NDArray[np.uint32]


@dataclass(frozen=True)
class Pages:
    """The bytes of a file without the checksums, which each page that is read is held to.

    Attributes
    ----------
    path : Path
    page : int
        Bytes of a page, its checksum included.
    size : int
        Bytes of the file.
    """

    path: Path
    page: int
    size: int

    def logical(self, physical: int) -> int:
        """Return where a byte of the file lies among those that count."""
        whole, rest = divmod(physical, self.page)
        return whole * (self.page - _CHECKSUM) + min(rest, self.page - _CHECKSUM)

    def read(self, start: int, length: int, *, physical: bool = False) -> bytes:
        """Return bytes that count, from one of them, or of the file, on.

        Raises
        ------
        PredictionError
            The file ends before they do, or a page does not have its checksum.
        """
        start = self.logical(start) if physical else start
        kept = self.page - _CHECKSUM
        first, last = start // kept, (start + length - 1) // kept
        if not 0 < length <= self.size or start < 0 or first * self.page >= self.size:
            raise damaged(self.path, "something lies beyond its end")
        with self.path.open("rb") as stream:
            stream.seek(first * self.page)
            raw = stream.read((last - first + 1) * self.page)
        self._check(raw, first)
        rows = (raw[place : place + kept] for place in range(0, len(raw), self.page))
        found = b"".join(rows)[start - first * kept :][:length]
        if len(found) != length:
            raise damaged(self.path, "something lies beyond its end")
        return found

    def _check(self, raw: bytes, first: int) -> None:
        whole = len(raw) // self.page
        pages = np.frombuffer(raw, np.uint8, whole * self.page).reshape(whole, self.page)
        stated = np.ascontiguousarray(pages[:, -_CHECKSUM:]).view(">u4")[:, 0]
        for start in range(0, whole, _PAGES_AT_ONCE):
            some = slice(start, start + _PAGES_AT_ONCE)
            wrong = np.flatnonzero(crc32c(pages[some, :-_CHECKSUM]) != stated[some])
            if wrong.size:
                page = first + start + int(wrong[0])
                raise damaged(self.path, f"page {page + 1} does not have its checksum")


def crc32c(rows: NDArray[np.uint8]) -> U32:
    """Return the CRC-32C of each row (N, L) of bytes.

    A CRC is linear but for its start: what each byte adds, by its place, is looked up.
    """
    table, of_zeros = _table_of_places(rows.shape[1])
    parts: U32 = table[np.arange(rows.shape[1]), rows]
    found: U32 = np.bitwise_xor.reduce(parts, axis=1) ^ of_zeros
    return found


@lru_cache(maxsize=2)
def _table_of_places(length: int) -> tuple[U32, np.uint32]:
    """Return what each byte adds at each place (length, 256), and the CRC of zeros."""
    last = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        last = (last >> np.uint32(1)) ^ np.where(last & 1, np.uint32(_POLYNOMIAL), np.uint32(0))
    table = np.empty((length, 256), np.uint32)
    added, start = last, np.uint32(_ALL_ONES)
    for place in range(length - 1, -1, -1):
        table[place] = added
        added = last[added & 255] ^ (added >> np.uint32(8))
        start = last[start & 255] ^ (start >> np.uint32(8))
    return table, start ^ np.uint32(_ALL_ONES)


def damaged(path: Path, what: str) -> PredictionError:
    """Make the error of a damaged file."""
    return refusal(path, f"the E57 file is damaged: {what}", fix=FIX_COPY)
