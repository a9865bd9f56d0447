"""Pages of E57 files: 4 bytes of checksum end each, and are no part of what lies in them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import FIX_COPY, refusal

__all__ = ["Pages", "damaged"]

_CHECKSUM = 4


@dataclass(frozen=True)
class Pages:
    """The bytes of a file without the checksums, which are not looked at.

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
            The file ends before they do.
        """
        start = self.logical(start) if physical else start
        kept = self.page - _CHECKSUM
        first, last = start // kept, (start + length - 1) // kept
        if not 0 < length <= self.size or start < 0 or first * self.page >= self.size:
            raise damaged(self.path, "something lies beyond its end")
        with self.path.open("rb") as stream:
            stream.seek(first * self.page)
            raw = stream.read((last - first + 1) * self.page)
        rows = (raw[place : place + kept] for place in range(0, len(raw), self.page))
        found = b"".join(rows)[start - first * kept :][:length]
        if len(found) != length:
            raise damaged(self.path, "something lies beyond its end")
        return found


def damaged(path: Path, what: str) -> PredictionError:
    """Make the error of a damaged file."""
    return refusal(path, f"the E57 file is damaged: {what}", fix=FIX_COPY)
