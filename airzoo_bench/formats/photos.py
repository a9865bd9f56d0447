"""Photos that strangers took: opened, or refused with one message."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image

from airzoo_bench.core.errors import BenchmarkError

PHOTO_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")  # their ids leave it out
# Pillow raises SyntaxError and ValueError over headers.
_DAMAGE = (OSError, ValueError, SyntaxError, struct.error, Image.DecompressionBombError)


@contextmanager
def open_photo(
    path: Path, fix: str = "copy it again, or take it out of the folder"
) -> Iterator[Image.Image]:
    """Open a photo; Pillow's errors inside the block become a BenchmarkError."""
    try:
        # Pillow warns of large photos, which a survey's are.
        with warnings.catch_warnings(action="ignore"), Image.open(path) as image:
            yield image
    except _DAMAGE as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise BenchmarkError(
            f"not a readable photo: {reason.replace(f' {str(path)!r}', '')}",
            where=path,
            expected="a complete " + ", ".join(PHOTO_SUFFIXES) + " file",
            fix=fix,
        ) from error
