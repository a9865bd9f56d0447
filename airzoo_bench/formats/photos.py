"""Photos that strangers took: opened, or refused with one message."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.ids import PHOTO_SUFFIXES

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["opened_photo"]


@contextmanager
def opened_photo(
    path: Path, fix: str = "copy it again, or take it out of the folder"
) -> Iterator[Image]:
    """Open a photo; what Pillow makes of a bad one inside the block becomes BenchmarkError."""
    from PIL import Image

    # Pillow raises SyntaxError and ValueError over headers, and warns of large photos, which a
    # survey's are.
    damage = (OSError, ValueError, SyntaxError, struct.error, Image.DecompressionBombError)
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path) as image:
            yield image
    except damage as error:
        raise BenchmarkError(
            f"not a readable photo: {_brief(error, path)}",
            where=path,
            expected="a complete " + ", ".join(PHOTO_SUFFIXES) + " file",
            fix=fix,
        ) from error


def _brief(error: Exception, path: Path) -> str:
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return text.replace(f" {str(path)!r}", "")
