"""From what users have to what the tracks take; what does not fit is refused by name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from itertools import combinations
from numbers import Integral, Real
from typing import Any

import numpy as np

from airzoo_bench.core.errors import ArgumentError, UserError, first_of
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.poses import FARTHEST, Poses, check_rotations
from airzoo_bench.geometry.precision import COARSEST_M, narrow_type, pose_errors_m

__all__ = [
    "are_centres",
    "choice",
    "coordinates",
    "finite",
    "floats",
    "in_order",
    "listed",
    "pose_rows",
    "positive",
    "refused",
    "same_index",
    "whole",
]

MOST = 2**31 - 1
_LAST_ROW = (0.0, 0.0, 0.0, 1.0)
_ROW_TOLERANCE = 1e-6
_DOUBLE = np.dtype(np.float64).itemsize


@contextmanager
def refused(what: str) -> Iterator[None]:
    """Turn what the tracks say of a file, a camera or a cloud into the fault of an argument."""
    try:
        yield
    except UserError as error:
        if isinstance(error, ArgumentError):
            raise
        raise ArgumentError(
            error.what, where=what, expected=error.expected, fix=error.fix
        ) from error


def floats(name: str, values: Any, shape: tuple[int | None, ...]) -> Floats:
    """Return numbers as a float64 array of a shape, in which None is any length.

    Raises
    ------
    ArgumentError
        Not numbers, or of another shape; an empty list has any shape.
    """
    expected = f"numbers of shape {_written(shape)}"
    array = _array(name, values, expected)
    if array.dtype.kind not in "iuf":
        raise ArgumentError(f"is of type {array.dtype}", where=name, expected=expected)
    if array.size == 0 and array.ndim == 1 and shape[0] is None:
        array = array.reshape(0, *(length or 0 for length in shape[1:]))
    fits = array.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise ArgumentError(f"has shape {array.shape}", where=name, expected=expected)
    return array.astype(np.float64)


def in_order(name: str, values: Any) -> Any:
    """Return what keeps an order and all that it shows, and refuse the rest.

    Raises
    ------
    ArgumentError
        A set or a dict, whose order or values would be passed over; an array some of whose entries
        are masked, which NumPy would unmask.
    """
    if isinstance(values, Set | Mapping):
        raise ArgumentError(
            f"is a {type(values).__name__}",
            where=name,
            expected="a list or array, whose order counts",
            fix="sort it: for a dict of scores, sorted(scores, key=scores.get, reverse=True)",
        )
    if isinstance(values, np.ma.MaskedArray):
        if np.ma.is_masked(values):
            raise ArgumentError(
                "has masked entries",
                where=name,
                expected="an array without a mask",
                fix="leave the entries out, or fill them: array.filled(np.nan)",
            )
        return values.data
    return values


def same_index(arguments: Mapping[str, Any]) -> None:
    """Refuse arguments of pandas, by name, whose rows are pairs but whose labels differ.

    Raises
    ------
    ArgumentError
        Two of one length have different indexes, or the same in another order.
    """
    labels = {name: rows.index for name, rows in arguments.items() if hasattr(rows, "iloc")}
    for (name, index), (other, second) in combinations(labels.items(), 2):
        if len(index) == len(second) and not index.equals(second):
            raise ArgumentError(
                "have different indexes, and rows would be paired by position",
                where=f"{name}, {other}",
                expected="the same labels in the same order",
                fix="give one the index of the other: b.reindex(a.index), or pass .to_numpy()",
            )


def _array(name: str, values: Any, expected: str) -> np.ndarray[Any, Any]:
    try:
        return np.asarray(in_order(name, values))
    except (ValueError, TypeError, RuntimeError) as error:
        # NumPy for ragged lists; torch for tensors that need a gradient or lie on a GPU.
        raise ArgumentError(
            f"cannot be an array: {error}", where=name, expected=expected
        ) from error


def _written(shape: tuple[int | None, ...]) -> str:
    letters = iter("NMKL")
    lengths = [next(letters) if length is None else str(length) for length in shape]
    return f"({', '.join(lengths)}{',' if len(lengths) == 1 else ''})"


def finite(name: str, values: Floats, most: float = np.inf) -> Floats:
    """Refuse rows that hold NaN, infinity or what is beyond a limit."""
    bad = np.flatnonzero(~np.isfinite(values).all(axis=tuple(range(1, values.ndim))))
    if bad.size:
        raise ArgumentError(
            f"holds NaN or infinity in rows {first_of(bad.tolist(), len(values))}",
            where=name,
            expected="finite numbers",
        )
    if np.abs(values).max(initial=0.0) > most:
        raise ArgumentError(
            f"holds numbers beyond {most:g}", where=name, expected=f"at most {most:g}"
        )
    return values


def coordinates(name: str, values: Any) -> Floats:
    """Return finite points (N, 3) of the world, in metres.

    Raises
    ------
    ArgumentError
        Also for coordinates that went through a type that does not keep centimetres of them, as
        float32 does not of projected coordinates.
    """
    points = finite(name, floats(name, values, (None, 3)), FARTHEST)
    given = np.asarray(in_order(name, values)).dtype
    is_narrow = given.kind == "f" and given.itemsize < _DOUBLE
    kind = given.type if is_narrow else narrow_type(points[:, :2])
    largest = float(np.abs(points).max(initial=0.0))
    step = 0.0 if kind is None else float(np.spacing(kind(largest)))
    if step > COARSEST_M:
        raise ArgumentError(
            f"{'is' if is_narrow else 'went through'} {np.dtype(kind)}, which keeps coordinates "
            f"such as {largest:.0f} to {step:.2g} m only",
            where=name,
            expected="float64, or coordinates from a local origin",
        )
    return points


def are_centres(name: str, values: Any) -> bool:
    """Tell camera centres (N, 3) from poses."""
    return _array(name, values, "poses (N, 3, 4) or (N, 4, 4), or centres (N, 3)").ndim == 2


def pose_rows(name: str, values: Any, *, missing: bool) -> tuple[Bools, Poses]:
    """Return which of N world-to-camera poses there are, and all of them, NaN where there is none.

    Parameters
    ----------
    name : str
    values : (N, 3, 4) or (N, 4, 4) array-like
        [R | t], above 0 0 0 1 where there are four rows.
    missing : bool
        Whether a pose may be NaN in all of it.

    Raises
    ------
    ArgumentError
        Another shape; matrices that are no poses; too few digits to place a camera to a
        centimetre.
    """
    expected = "poses of shape (N, 3, 4) or (N, 4, 4)"
    rows = 4 if _array(name, values, expected).shape[1:2] == (4,) else 3
    matrices = floats(name, values, (None, rows, 4))
    found = _found(name, matrices, missing=missing)
    given = matrices[found]
    names = [f"row {row}" for row in np.flatnonzero(found).tolist()]
    _check_last_row(name, given, names)
    with refused(name):
        exact = check_rotations(given[:, :3, :3], names)
        made = Poses.from_translations(exact, given[:, :3, 3], names)
    _refuse_coarse(name, given, names)
    rotation, centres = np.full((len(matrices), 3, 3), np.nan), np.full((len(matrices), 3), np.nan)
    rotation[found], centres[found] = made.rotation, made.centres
    return found, Poses(rotation=rotation, centres=centres)


def _found(name: str, matrices: Floats, *, missing: bool) -> Bools:
    found = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    # A last row of 0 0 0 1 may be left beside NaN.
    empty = np.isnan(matrices[:, :3]).all(axis=(1, 2)) & missing
    bad = np.flatnonzero(~found & ~empty)
    if bad.size:
        raise ArgumentError(
            f"holds NaN or infinity in poses {first_of(bad.tolist(), len(matrices))}",
            where=name,
            expected="whole poses" + (", or NaN in all of a pose that is missing" * missing),
        )
    return found


def _check_last_row(name: str, matrices: Floats, names: Sequence[str]) -> None:
    if matrices.shape[1] != 4:
        return
    wrong = np.flatnonzero(~(np.abs(matrices[:, 3] - _LAST_ROW) <= _ROW_TOLERANCE).all(axis=1))
    if wrong.size:
        named = first_of([names[row] for row in wrong.tolist()], len(names))
        raise ArgumentError(
            f"a last row other than 0 0 0 1: {named}",
            where=name,
            expected="[R | t] above 0 0 0 1",
            fix="transpose the matrices, if their last row holds t",
        )


def _refuse_coarse(name: str, matrices: Floats, names: Sequence[str]) -> None:
    errors = pose_errors_m(matrices[:, :3, :3], matrices[:, :3, 3], None)
    coarse = np.flatnonzero(errors > COARSEST_M)
    if coarse.size:
        raise ArgumentError(
            f"too few digits in {first_of([names[row] for row in coarse.tolist()], len(names))}: "
            f"rounding alone moves cameras by {errors[coarse].max():.2g} m",
            where=name,
            expected=f"digits that place a camera to {COARSEST_M} m",
            fix=f"compute poses in float64; nothing within {FARTHEST:g} m is too far for it",
        )


def listed(name: str, values: Any) -> list[Any]:
    """Return what can be iterated over as a list."""
    if isinstance(values, str | bytes) or not isinstance(values, Iterable):
        raise ArgumentError(f"is {values!r}", where=name, expected=f"several, such as [{values!r}]")
    values = in_order(name, values)
    # A DataFrame would give the names of its columns.
    return list(np.asarray(values) if hasattr(values, "__array__") else values)


def whole(name: str, value: Any, least: int = 1) -> int:
    """Return a whole number from `least` to what 31 bits hold, as solvers take seeds."""
    is_whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not is_whole or not least <= int(value) <= MOST:
        raise ArgumentError(
            f"is {value!r}", where=name, expected=f"a whole number from {least} to {MOST:,}"
        )
    return int(value)


def positive(name: str, value: Any) -> float:
    """Return a finite number above 0."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not 0.0 < float(value) <= FARTHEST:
        raise ArgumentError(
            f"is {value!r}", where=name, expected=f"a number above 0, at most {FARTHEST:g}"
        )
    return float(value)


def choice(name: str, value: object, known: Sequence[object]) -> None:
    """Refuse what is none of the known values."""
    if not any(value is one or value == one for one in known):
        raise ArgumentError(
            f"is {value!r}", where=name, expected="one of " + ", ".join(map(repr, known))
        )
