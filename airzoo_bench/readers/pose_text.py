"""Poses as lines of numbers: text as hloc, LTVL, TUM and KITTI write it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.core.files import first_bytes, read_text

if TYPE_CHECKING:
    from airzoo_bench.geometry.arrays import Floats

__all__ = ["LIMIT_BYTES", "PoseRows", "first_rows", "numbers_of", "pose_rows", "unit_share"]

LIMIT_BYTES = 1 << 27
_HEAD_BYTES, _HEAD_ROWS = 1 << 16, 50
_BYTES_A_BYTE = 32  # of memory, while the words of a line are texts and numbers of Python
_UNIT_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class PoseRows:
    """Rows of a text: their names, empty where the layout has none, and their numbers (N, C)."""

    names: list[str]
    values: Floats


def first_rows(path: Path) -> list[list[str]]:
    """Return the first rows of a text, split at blanks; none of what is no text."""
    if not path.is_file() or path.suffix.lower() not in ("", ".txt", ".tum", ".kitti", ".log"):
        return []
    head = first_bytes(path, _HEAD_BYTES)
    try:
        text = (head[: head.rfind(b"\n")] if len(head) == _HEAD_BYTES else head).decode()
    except UnicodeDecodeError:
        return []
    return list(islice(_rows(text), _HEAD_ROWS))


def _rows(text: str) -> list[list[str]]:
    lines = text.removeprefix("\ufeff").splitlines()
    return [line.split() for line in lines if line.strip() and line.lstrip()[0] != "#"]


def numbers_of(rows: list[list[str]], start: int) -> Floats | None:
    """Return the numbers of rows from a column on; None where some are none, or rows differ."""
    import numpy as np

    if len({len(row) for row in rows}) != 1:
        return None
    try:
        return np.array([[float(word) for word in row[start:]] for row in rows], dtype=np.float64)
    except ValueError:
        return None


def unit_share(values: Floats) -> float:
    """Return the share of rows (N, 4) of length 1; rows that are not finite are not counted."""
    import numpy as np

    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.linalg.norm(values, axis=1)
    lengths = lengths[np.isfinite(lengths)]
    return float((np.abs(lengths - 1) <= _UNIT_TOLERANCE).mean()) if len(lengths) else 0.0


def pose_rows(path: Path, columns: int, *, named: bool, memory_bytes: int) -> PoseRows:
    """Read all rows of a text of poses."""
    from airzoo_bench.formats.budget import Budget

    Budget(memory_bytes).hold(path, "its text", path.stat().st_size * _BYTES_A_BYTE)
    rows = _rows(read_text(path, UnreadableError, "text of poses", LIMIT_BYTES))
    wrong = [number for number, row in enumerate(rows, 1) if len(row) != columns + named]
    if wrong or not rows:
        raise PredictionError(
            f"row {wrong[0]} has {len(rows[wrong[0] - 1])} columns" if rows else "holds no pose",
            where=path,
            expected=f"{'a name and ' if named else ''}{columns} numbers in each row",
        )
    values = numbers_of(rows, int(named))
    if values is None:
        raise PredictionError("holds words where numbers should be", where=path)
    return PoseRows([row[0] for row in rows] if named else [], values)
