"""From what users have to what the tracks take; what does not fit is refused by name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.api.labels import in_axis_order
from airzoo_bench.core.errors import ArgumentError, UserError, first_of
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import FARTHEST
from airzoo_bench.geometry.precision import COARSEST_M, narrow_type

__all__ = [
    "as_array",
    "choice",
    "coordinates",
    "finite",
    "floats",
    "in_order",
    "listed",
    "numbers",
    "path_of",
    "positive",
    "refused",
    "text_of",
    "whole",
]

MOST = 2**31 - 1
_LONGEST_NAME = 255  # of a file, on the systems that there are
_DOUBLE = np.dtype(np.float64).itemsize


@contextmanager
def refused(what: str) -> Iterator[None]:
    """Turn a track's error about a file, a camera or a cloud into that of an argument."""
    try:
        yield
    except UserError as error:
        if isinstance(error, ArgumentError):
            raise
        raise ArgumentError(
            error.what, where=what, expected=error.expected, fix=error.fix
        ) from error


def numbers(name: str, values: Any, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Return numbers as an array of a shape, in which None is any length."""
    expected = f"numbers of shape {_written(shape)}"
    array = as_array(name, values, expected)
    if array.dtype.kind not in "iuf":
        raise ArgumentError(f"is of type {array.dtype}", where=name, expected=expected)
    if array.size == 0 and array.ndim == 1 and shape[0] is None:
        array = array.reshape(0, *(length or 0 for length in shape[1:]))
    fits = array.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise ArgumentError(f"has shape {array.shape}", where=name, expected=expected)
    return array


def floats(name: str, values: Any, shape: tuple[int | None, ...]) -> Floats:
    """Return `numbers` in double precision, as a copy."""
    return numbers(name, values, shape).astype(np.float64)


def in_order(name: str, values: Any) -> Any:
    """Return what keeps an order and all that it shows, and refuse the rest."""
    if isinstance(values, Set | Mapping):
        raise ArgumentError(
            f"is a {type(values).__name__}",
            where=name,
            expected="a list or array, whose order counts",
            fix="sort it: for a dict of scores, sorted(scores, key=scores.get, reverse=True)",
        )
    parts = values if isinstance(values, list | tuple) else (values,)
    if any(np.ma.is_masked(part) for part in parts if isinstance(part, np.ma.MaskedArray)):
        raise ArgumentError(
            "has masked entries",
            where=name,
            expected="an array without a mask",
            fix="leave the entries out, or fill them: array.filled(np.nan)",
        )
    return values.data if isinstance(values, np.ma.MaskedArray) else values


def as_array(name: str, values: Any, expected: str) -> NDArray[Any]:
    """Return an array of any type and shape; columns called x, y, z are taken by their names."""
    ordered = in_order(name, values)
    ordered = in_axis_order(ordered) if hasattr(ordered, "columns") else ordered
    try:
        return np.asarray(ordered)
    except (ValueError, TypeError, RuntimeError) as error:
        # NumPy for ragged lists; torch for tensors that need a gradient or lie on a GPU.
        raise ArgumentError(
            f"cannot be an array: {error}", where=name, expected=expected
        ) from error


def path_of(name: str, value: Any) -> Path:
    """Return a path."""
    if not isinstance(value, str | Path):
        raise ArgumentError(
            f"is {value!r}"[:80], where=name, expected="a path, such as 'results/mymethod'"
        )
    if "\0" in str(value) or any(len(part) > _LONGEST_NAME for part in Path(value).parts):
        raise ArgumentError("is no path of a file system", where=name, expected="a path")
    return Path(value)


def text_of(name: str, value: Any) -> str | None:
    """Return a name or a path as text, or None where nothing is given."""
    if value is None or isinstance(value, str | Path):
        return None if value is None else str(value)
    raise ArgumentError(f"is {value!r}"[:80], where=name, expected="a name, as text")


def _written(shape: tuple[int | None, ...]) -> str:
    letters = iter("NMKL")
    lengths = [next(letters) if length is None else str(length) for length in shape]
    return f"({', '.join(lengths)}{',' if len(lengths) == 1 else ''})"


def finite(name: str, values: Floats, most: float = np.inf) -> Floats:
    """Refuse rows that hold NaN, infinity or what is beyond a limit."""
    bad = np.flatnonzero(~np.isfinite(values).all(axis=tuple(range(1, values.ndim))))
    if bad.size:
        raise ArgumentError(
            f"holds NaN or infinity in {first_of(bad.tolist(), len(values), noun='row')}",
            where=name,
            expected="finite numbers",
        )
    if np.abs(values).max(initial=0.0) > most:
        raise ArgumentError(
            f"holds numbers beyond {most:g}", where=name, expected=f"at most {most:g}"
        )
    return values


def coordinates(
    name: str,
    values: Any,
    shape: tuple[int | None, ...] = (None, 3),
    *,
    any_history: bool = False,
) -> Floats:
    """Return finite points of the world, in metres, or what else is of such digits."""
    given = numbers(name, values, shape)
    points = finite(name, given.astype(np.float64), FARTHEST)
    kind: type[np.floating[Any]] | None = None
    is_narrow = given.dtype.kind == "f" and given.dtype.itemsize < _DOUBLE
    if is_narrow:
        kind = given.dtype.type
    elif not any_history:
        kind = narrow_type(points[:, :2])
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
