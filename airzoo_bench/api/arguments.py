"""Arguments of the Python face: array-likes in, clean arrays out, or an error that names one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import ArgumentError, UserError, first_of
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.poses import FARTHEST, Poses, check_rotations
from airzoo_bench.geometry.precision import COARSEST_M, narrow_type, pose_errors_m

_LARGEST_INT = 2**31 - 1  # solvers take seeds of 31 bits


@contextmanager
def refused(argument: str) -> Iterator[None]:
    """Turn an error about a file, a camera or a cloud into one about an argument."""
    try:
        yield
    except ArgumentError:
        raise
    except UserError as error:
        raise ArgumentError(
            error.what, where=argument, expected=error.expected, fix=error.fix
        ) from error


def array_of(name: str, values: Any, expected: str = "an array") -> NDArray[Any]:
    """Return an array of any type; sets, dicts and masked entries have no place in one."""
    parts = values if isinstance(values, list | tuple) else (values,)
    if isinstance(values, Set | Mapping):
        what = f"is a {type(values).__name__}, which has no order"
        raise ArgumentError(what, where=name, expected=expected)
    if any(isinstance(part, np.ma.MaskedArray) and np.ma.is_masked(part) for part in parts):
        fix = "leave the entries out, or fill them: array.filled(np.nan)"
        raise ArgumentError("has masked entries", where=name, expected=expected, fix=fix)
    try:
        return np.asarray(values)
    except (ValueError, TypeError, RuntimeError) as error:
        # NumPy for ragged lists; torch for tensors that need a gradient or lie on a GPU.
        what = f"cannot be an array: {error}"
        raise ArgumentError(what, where=name, expected=expected) from error


def numbers(name: str, values: Any, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Return numbers as an array of a shape, in which None is any length."""
    letters = iter("NMKL")
    lengths = [next(letters) if length is None else str(length) for length in shape]
    expected = f"numbers of shape ({', '.join(lengths)}{',' * (len(lengths) == 1)})"
    array = array_of(name, values, expected)
    if array.dtype.kind not in "iuf":
        raise ArgumentError(f"is of type {array.dtype}", where=name, expected=expected)
    if array.shape == (0,) and shape[0] is None:
        array = array.reshape(0, *(length or 0 for length in shape[1:]))
    if array.ndim != len(shape) or any(
        want not in (None, have) for want, have in zip(shape, array.shape, strict=True)
    ):
        raise ArgumentError(f"has shape {array.shape}", where=name, expected=expected)
    return array


def floats(name: str, values: Any, shape: tuple[int | None, ...]) -> Floats:
    """Return `numbers` in double precision, as a copy."""
    return numbers(name, values, shape).astype(np.float64)


def refuse_rows(
    name: str, bad: Bools, what: str, expected: str, fix: str | None = None, noun: str = "row"
) -> None:
    """Refuse an argument that has bad rows, and name the first of them."""
    rows = np.flatnonzero(bad).tolist()
    if rows:
        found = f"{what} in {first_of(rows, len(bad), noun=noun)}"
        raise ArgumentError(found, where=name, expected=expected, fix=fix)


def finite(name: str, values: Floats) -> Floats:
    """Refuse rows that hold NaN, infinity or numbers whose squares would overflow."""
    good = np.isfinite(values) & (np.abs(values) <= FARTHEST)
    bad = np.asarray(~good.all(axis=tuple(range(1, values.ndim))))
    refuse_rows(name, bad, "NaN or infinity", f"finite numbers up to {FARTHEST:g}")
    return values


def coordinates(
    name: str, values: Any, shape: tuple[int | None, ...] = (None, 3), *, any_history: bool = False
) -> Floats:
    """Return finite points in metres; float32 of projected coordinates has lost centimetres."""
    given = numbers(name, values, shape)
    points = finite(name, given.astype(np.float64))
    is_narrow = given.dtype.kind == "f" and given.dtype.itemsize < points.dtype.itemsize
    went_through = None if any_history else narrow_type(points[..., :2])
    check_digits(name, points, given.dtype.type if is_narrow else went_through)
    return points


def check_digits(name: str, points: Floats, kind: Any, coarsest: float = COARSEST_M) -> None:
    """Refuse coordinates that were of a type whose step is too large for them; None is float64."""
    largest = float(np.abs(points).max(initial=0.0))
    step = 0.0 if kind is None else float(np.spacing(kind(largest)))
    if step > coarsest:
        raise ArgumentError(
            f"is or was {np.dtype(kind)}, which keeps coordinates such as {largest:.0f} to "
            f"{step:.2g} only",
            where=name,
            expected="float64, or coordinates from a local origin",
        )


def pose_rows(name: str, values: Any, *, may_be_missing: bool) -> Poses:
    """Return world-to-camera poses (N, 3, 4) or (N, 4, 4), NaN where one is missing."""
    is_square = array_of(name, values, "poses of shape (N, 3, 4)").shape[1:2] == (4,)
    matrices = floats(name, values, (None, 3 + is_square, 4))
    there = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    empty = np.isnan(matrices[:, :3]).all(axis=(1, 2)) & may_be_missing
    expected = "whole poses, or all of one NaN where allowed"
    refuse_rows(name, ~there & ~empty, "NaN or infinity", expected, noun="pose")
    if is_square:
        off = ~(np.abs(matrices[:, 3] - (0, 0, 0, 1)) <= 1e-6).all(axis=1) & there
        fix = "transpose the matrices, if their last row holds t"
        expected = "[R | t] above 0 0 0 1"
        refuse_rows(name, off, "a last row other than 0 0 0 1", expected, fix, "pose")
    names = [f"row {row}" for row in np.flatnonzero(there).tolist()]
    turns, moves = matrices[there, :3, :3], matrices[there, :3, 3]
    with refused(name):
        made = Poses.from_translations(check_rotations(turns, names), moves, names)
    coarse = there.copy()
    coarse[there] = pose_errors_m(turns, moves, None) > COARSEST_M
    expected = f"digits that place a camera to {COARSEST_M} m: poses computed in float64"
    refuse_rows(name, coarse, "too few digits", expected, noun="pose")
    rotation, centres = np.full((len(there), 3, 3), np.nan), np.full((len(there), 3), np.nan)
    rotation[there], centres[there] = made.rotation, made.centres
    return Poses(rotation=rotation, centres=centres)


def same_length(one: str, rows: Any, other: str, others: Any) -> None:
    """Refuse arguments whose rows are pairs but whose numbers differ."""
    if len(rows) != len(others):
        raise ArgumentError(
            f"have {len(rows)} and {len(others)} rows",
            where=f"{one}, {other}",
            expected="as many rows, in the same order",
        )


def same_index(**arguments: Any) -> None:
    """Refuse pandas objects whose rows are pairs but whose labels differ."""
    labels = {name: rows.index for name, rows in arguments.items() if hasattr(rows, "iloc")}
    first = next(iter(labels), "")
    for name, index in labels.items():
        if len(index) == len(labels[first]) and not index.equals(labels[first]):
            raise ArgumentError(
                "have different indexes, and would be paired by position",
                where=f"{first}, {name}",
                expected="the same labels in the same order",
                fix="give one the index of the other: b.reindex(a.index), or pass .to_numpy()",
            )


def listed(name: str, values: Any) -> list[Any]:
    """Return several values as a list."""
    if hasattr(values, "__array__"):  # a DataFrame would give the names of its columns
        array = array_of(name, values)
        values = list(array) if array.ndim else array.item()
    if isinstance(values, str | bytes | Mapping) or not isinstance(values, Iterable):
        raise ArgumentError(f"is {values!r}"[:80], where=name, expected="a list")
    return list(values)


def whole(name: str, value: Any, least: int = 1, most: int = _LARGEST_INT) -> int:
    """Return a whole number within limits."""
    is_whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not is_whole or not least <= int(value) <= most:
        expected = f"a whole number from {least} to {most:,}"
        raise ArgumentError(f"is {value!r}", where=name, expected=expected)
    return int(value)


def positive(name: str, value: Any, most: float = FARTHEST) -> float:
    """Return a number above 0, at most `most`."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not 0.0 < float(value) <= most:
        expected = f"a number above 0, at most {most:g}"
        raise ArgumentError(f"is {value!r}", where=name, expected=expected)
    return float(value)


def choice(name: str, value: object, known: Sequence[object]) -> None:
    """Refuse what is none of the known values."""
    if not any(value is one or value == one for one in known):
        expected = "one of " + ", ".join(map(repr, known))
        raise ArgumentError(f"is {value!r}", where=name, expected=expected)
