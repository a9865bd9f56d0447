"""Ids of queries and tiles: ``scene/name``, each once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of

PHOTO_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
"""What the names of photos end in; their ids leave it out."""

IMAGE_SUFFIXES = (
    *PHOTO_SUFFIXES,
    *(".webp", ".bmp", ".gif", ".heic", ".heif", ".avif", ".jp2", ".dng", ".ppm", ".pgm", ".exr"),
)

_BYTES_OF_LETTER = 4

Texts = NDArray[np.str_]


def scene_of(ids: Texts) -> Texts:
    """Return the scene part of ids ``scene/name``."""
    return np.char.partition(ids, "/")[..., 0] if ids.size else np.zeros(ids.shape, ids.dtype)


def with_endings(ids: Texts) -> bool:
    """Tell whether most ids end as files of images do, in letters of either case."""
    ends = [str(name).lower().endswith(IMAGE_SUFFIXES) for name in ids]
    return sum(ends) * 2 > len(ends)


def check_ids(ids: Texts, where: str) -> None:
    """Refuse ids without a scene or a name, and repeated ids."""
    if not ids.size:
        raise PredictionError(
            "holds no id", where=where, expected="ids such as city/DJI_0001", fix="fill the file"
        )
    place = np.char.find(ids, "/")
    unscened = np.flatnonzero((place <= 0) | (place == np.char.str_len(ids) - 1))
    if unscened.size:
        listed = [repr(str(name)) for name in ids[unscened]]
        raise PredictionError(
            f"ids without a scene or a name: {first_of(listed, len(ids))}",
            where=where,
            expected="scene/name, such as city/DJI_0001",
            fix="put the scene before each name",
        )
    unique, counts = np.unique(ids, return_counts=True)
    if unique.size < ids.size:
        raise PredictionError(
            f"ids more than once: {first_of(unique[counts > 1], len(unique))}",
            where=where,
            expected="each id once",
            fix="keep one row of each",
        )


def rows_among(names: Texts, known: Texts) -> NDArray[np.intp]:
    """Return the row of each name among known ones, -1 for the others."""
    letters = max(1, *(texts.dtype.itemsize // _BYTES_OF_LETTER for texts in (names, known)))
    found = pc.index_in(_as_bytes(names, letters), value_set=_as_bytes(known, letters))
    rows: NDArray[np.intp] = pc.fill_null(found, -1).to_numpy().astype(np.intp)
    return rows


def _as_bytes(texts: Texts, letters: int) -> Any:
    """Return texts as Arrow's values of one width, which it compares without reading letters."""
    # A text in NumPy ends in as many NUL as it is shorter, and so do equal ones of other widths.
    filled = np.ascontiguousarray(texts, f"<U{letters}")
    kind = pa.binary(letters * _BYTES_OF_LETTER)
    return pa.FixedSizeBinaryArray.from_buffers(kind, len(filled), [None, pa.py_buffer(filled)])
