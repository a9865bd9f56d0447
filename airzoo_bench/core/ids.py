"""Ids of queries and tiles: ``scene/name``, each once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of

PHOTO_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")  # their ids leave it out
_OTHERS = ".webp .bmp .gif .heic .heif .avif .jp2 .dng .ppm .pgm .exr"
IMAGE_SUFFIXES = (*PHOTO_SUFFIXES, *_OTHERS.split())

Texts = NDArray[np.str_]


def check_ids(ids: Texts, where: str) -> None:
    """Refuse ids without a scene or a name, repeated ids, and none."""
    place = np.char.find(ids, "/")
    unscened = ids[(place <= 0) | (place == np.char.str_len(ids) - 1)]
    unique, counts = np.unique(ids, return_counts=True)
    faults = {"without a scene or a name": unscened, "more than once": unique[counts > 1]}
    for fault, wrong in faults.items():
        if wrong.size or not ids.size:
            listed = first_of(map(repr, wrong.tolist()), len(ids))
            what = f"ids {fault}: {listed}" if ids.size else "holds no id"
            expected = "scene/name, such as city/DJI_0001, each once"
            raise PredictionError(what, where=where, expected=expected)


def rows_among(names: Texts, known: Texts) -> NDArray[np.intp]:
    """Return the row of each name among known ones, -1 for the others."""
    letters = max(1, *(texts.dtype.itemsize // 4 for texts in (names, known)))

    def as_bytes(texts: Texts) -> Any:
        # A text in NumPy ends in as many NUL as it is shorter: values of one width are compared.
        filled = np.ascontiguousarray(texts, f"<U{letters}")
        parts = [None, pa.py_buffer(filled)]
        return pa.FixedSizeBinaryArray.from_buffers(pa.binary(letters * 4), len(filled), parts)

    found = pc.index_in(as_bytes(names), value_set=as_bytes(known))
    return np.asarray(pc.fill_null(found, -1).to_numpy(), np.intp)
