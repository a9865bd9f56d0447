"""Priors by hand, for photos whose metadata lack them: a table of positions and gimbal angles."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.datasets.dji import PhotoPrior

__all__ = ["PRIOR_VALUES", "read_prior_file", "with_given"]

PRIOR_VALUES = ("lon", "lat", "altitude_m", "yaw_deg", "pitch_deg", "roll_deg")
_LIMITS = {"lon": 180.0, "lat": 90.0}
_LIMIT_BYTES = 64 << 20


def read_prior_file(path: Path, photos: Iterable[str]) -> dict[str, dict[str, float]]:
    """Read a CSV with the column ``image`` and some of `PRIOR_VALUES`.

    Parameters
    ----------
    path : Path
    photos : iterable of str
        The names of the photos that there are.

    Returns
    -------
    dict of str to dict
        What is given for each photo; empty cells are left out.

    Raises
    ------
    BenchmarkError
        The file is not such a table, names a photo twice or one that there is not, or a value is
        no number or beyond its range.
    """
    text = read_text(path, BenchmarkError, "table of priors", _LIMIT_BYTES)
    try:
        rows = list(csv.DictReader(io.StringIO(text.removeprefix("\ufeff")), strict=True))
    except csv.Error as error:
        raise BenchmarkError(f"not a CSV: {error}", where=path) from error
    columns = set(rows[0]) if rows else set()
    if "image" not in columns or not columns <= {"image", *PRIOR_VALUES}:
        raise BenchmarkError(
            f"has the columns {', '.join(map(str, sorted(columns, key=str)))}",
            where=path,
            expected=f"image, and some of {', '.join(PRIOR_VALUES)}",
        )
    names = [row["image"] for row in rows]
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    _refuse_names(twice, "named twice", path)
    there = set(photos)
    _refuse_names([name for name in names if name not in there], "no photos", path)
    return {row["image"]: _values(row, number, path) for number, row in enumerate(rows, start=2)}


def with_given(prior: PhotoPrior, given: dict[str, float]) -> PhotoPrior:
    """Return a photo's prior with what was given for it in place of its own."""
    return replace(prior, **given)


def _values(row: dict[str, str], line: int, path: Path) -> dict[str, float]:
    found = {}
    for name in PRIOR_VALUES:
        text = (row.get(name) or "").strip()
        if not text:
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not abs(value) <= _LIMITS.get(name, 1e6):
            raise BenchmarkError(
                f"column {name}, line {line}: {text[:40]!r}",
                where=path,
                expected=f"a number, at most {_LIMITS[name]:g} either way"
                if name in _LIMITS
                else "a number",
            )
        found[name] = value
    return found


def _refuse_names(names: list[str], what: str, path: Path) -> None:
    if names:
        raise BenchmarkError(
            f"{what}: {first_of(map(repr, names))}",
            where=path,
            expected="each photo once, by its name relative to the folder of the photos",
        )
