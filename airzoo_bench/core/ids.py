"""Ids of queries and tiles: ``scene/name``, each once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.plurals import counted
from airzoo_bench.core.validation import nearest

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

__all__ = [
    "IMAGE_SUFFIXES",
    "PHOTO_SUFFIXES",
    "Assignment",
    "assign_queries",
    "check_ids",
    "rows_among",
    "scene_of",
    "with_endings",
]

PHOTO_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
"""What the names of photos end in; their ids leave it out."""

IMAGE_SUFFIXES = (
    *PHOTO_SUFFIXES,
    *(".webp", ".bmp", ".gif", ".heic", ".heif", ".avif", ".jp2", ".dng", ".ppm", ".pgm", ".exr"),
)

_SHOWN = 3
_SHOWN_LETTERS = 80
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
    """Refuse ids without a scene or a name, and ids that stand more than once."""
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


@dataclass(frozen=True, eq=False)
class Assignment:
    """Which row of the predictions answers which query.

    Attributes
    ----------
    rows : list of (Q,) int
        For each scene the row of each query, -1 where the predictions lack it.
    missing : (M,) str
        The queries that the predictions lack.
    strange : (S,) str
        Ids of the predictions that are no query of any scene.
    """

    rows: list[NDArray[np.intp]]
    missing: Texts
    strange: Texts

    @property
    def covered(self) -> str:
        """How many of the queries are answered, such as ``15 of 18 queries``."""
        asked = sum(map(len, self.rows))
        return f"{asked - len(self.missing):,} of {counted(asked, 'query')}"

    def notes(self) -> list[str]:
        """Name the first queries that are missing, and the first ids that are none."""
        notes = []
        if self.missing.size:
            named = first_of(self.missing, sum(len(found) for found in self.rows), _SHOWN)
            notes.append(f"queries that the predictions lack, scored at their worst: {named}")
        if self.strange.size:
            # Each id stands once: what a mistyped one means is among the queries that are missing.
            absent = self.missing.tolist()
            shown = [
                repr(name[:_SHOWN_LETTERS]) + nearest(name, absent, 1)
                for name in self.strange[:_SHOWN].tolist()
            ]
            named = first_of([*shown, *self.strange[_SHOWN:]], shown=_SHOWN)
            notes.append(f"ids of the predictions that are no queries, left aside: {named}")
        return notes


def assign_queries(given: Texts, scenes: Sequence[pd.Series[str]]) -> Assignment:
    """Find the row of the predictions that answers each query."""
    asked = np.concatenate([np.zeros(0, "<U1"), *(ids.to_numpy(str) for ids in scenes)])
    found = rows_among(asked, given)
    strange = np.ones(len(given), np.bool_)
    strange[found[found >= 0]] = False
    ends = np.cumsum([len(ids) for ids in scenes], dtype=np.intp)
    return Assignment(np.split(found, ends)[:-1], asked[found < 0], given[strange])


def rows_among(names: Texts, known: Texts) -> NDArray[np.intp]:
    """Return the row of each name among known ones, -1 for the others."""
    import pyarrow.compute as pc

    letters = max(1, *(texts.dtype.itemsize // _BYTES_OF_LETTER for texts in (names, known)))
    found = pc.index_in(_as_bytes(names, letters), value_set=_as_bytes(known, letters))
    rows: NDArray[np.intp] = pc.fill_null(found, -1).to_numpy().astype(np.intp)
    return rows


def _as_bytes(texts: Texts, letters: int) -> Any:
    """Return texts as Arrow's values of one width, which it compares without reading letters."""
    import pyarrow as pa

    # A text in NumPy ends in as many NUL as it is shorter, and so do equal ones of other widths.
    filled = np.ascontiguousarray(texts, f"<U{letters}")
    kind = pa.binary(letters * _BYTES_OF_LETTER)
    return pa.FixedSizeBinaryArray.from_buffers(kind, len(filled), [None, pa.py_buffer(filled)])
