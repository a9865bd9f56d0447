"""Arguments and answers of functions on arrays: array-likes in, scores by name out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from functools import cache
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import ArgumentError, UserError, first_of
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import FARTHEST
from airzoo_bench.geometry.precision import COARSEST_M, narrow_type
from airzoo_bench.protocol.model import load_protocol, shipped_protocols

Shape = tuple[int | None, ...]


class Scores:
    """Scores by name, as items and attributes: ``found["recall@1"]``, ``found.f1``.

    `scores` is a mapping that is shown with four decimals; `more` is further attributes, such as
    the table ``records``.
    """

    def __init__(self, scores: Mapping[str, Any], **more: Any) -> None:
        self.scores = dict(scores)
        vars(self).update(self.scores | more)

    def __getitem__(self, name: str) -> Any:
        return self.scores[name]

    def __repr__(self) -> str:
        width = max(map(len, self.scores))
        shown = {n: f"{v:.4f}" if isinstance(v, float) else v for n, v in self.scores.items()}
        return "\n".join(["Scores", *(f"  {name:<{width}}  {v}" for name, v in shown.items())])


@cache
def shipped(track: str, section: str, **changes: Any) -> Any:
    """Return a section of the settings of shipped protocols, some of them changed."""
    protocol = load_protocol(shipped_protocols()[f"photos-{track}"])
    return getattr(protocol, section).model_copy(update=changes)


def fault(where: str, what: str, expected: str, fix: str | None = None) -> ArgumentError:
    """Make the error of an argument."""
    return ArgumentError(what, where=where, expected=expected, fix=fix)


@contextmanager
def refused(argument: str) -> Iterator[None]:
    """Turn an error about a file, a camera or a cloud into one about an argument."""
    try:
        yield
    except UserError as error:
        raise fault(argument, error.what, error.expected or "", error.fix) from error


def as_array(name: str, values: Any) -> NDArray[Any]:
    """Return an array of any type; masks, which NumPy would drop, are refused."""
    if np.ma.is_masked(values):
        raise fault(name, "has masked entries", "an array", "fill them: array.filled(np.nan)")
    return np.asarray(values)


def numbers(name: str, values: Any, shape: Shape) -> NDArray[Any]:
    """Return numbers of any type as an array of a shape, in which None is any length."""
    array = as_array(name, values)
    if array.shape == (0,):
        array = array.reshape([length or 0 for length in shape])
    fits = [want in (None, have) for want, have in zip(shape, array.shape, strict=False)]
    if len(shape) != array.ndim or not all(fits) or array.dtype.kind not in "biuf":
        expected = f"numbers of shape {shape}".replace("None", "any")
        raise fault(name, f"is {array.dtype} of shape {array.shape}", expected)
    return array


def floats(name: str, values: Any, shape: Shape, *, finite: bool = False) -> Floats:
    """Return `numbers` in double precision, as a copy; finite ones have squares that are too."""
    array = numbers(name, values, shape).astype(np.float64)
    if finite:
        bad = ~(np.abs(array) <= FARTHEST).all(axis=tuple(range(1, array.ndim)))
        refuse_rows(name, bad, "NaN or infinity", f"finite numbers up to {FARTHEST:g}")
    return array


def coordinates(name: str, values: Any) -> Floats:
    """Return finite points (N, 3) of a type that keeps them, and that kept them before."""
    points = floats(name, values, (None, 3), finite=True)
    for kind in (as_array(name, values).dtype.type, narrow_type(points[:, :2])):
        check_digits(name, points, kind)
    return points


def check_digits(name: str, points: Floats, kind: Any, coarsest: float = COARSEST_M) -> None:
    """Refuse coordinates that are or were floats of too few digits."""
    if kind in (np.float16, np.float32):
        largest = float(np.abs(points).max(initial=0.0))
        step = float(np.spacing(kind(largest)))
        if not step <= coarsest:
            what = f"is or was {np.dtype(kind)}, which keeps {largest:.0f} to {step:.2g} only"
            raise fault(name, what, "float64, or coordinates from a local origin")


def refuse_rows(name: str, bad: Any, what: str, expected: str) -> None:
    """Refuse an argument that has bad rows, and name the first of them."""
    if rows := np.flatnonzero(bad).tolist():
        raise fault(name, f"{what} in {first_of(rows, np.size(bad), noun='row')}", expected)


def check_pairs(**arguments: Any) -> None:
    """Refuse paired arguments with different numbers of rows."""
    (first, rows), *others = arguments.items()
    for name, other in others:
        if hasattr(rows, "__len__") and hasattr(other, "__len__") and len(rows) != len(other):
            what = f"have {len(rows)} and {len(other)} rows"
            raise fault(f"{first}, {name}", what, "as many, in one order")


def listed(name: str, values: Any) -> list[Any]:
    """Return several values as a list."""
    if hasattr(values, "__array__"):  # a DataFrame would give the names of its columns
        values = as_array(name, values).tolist()
    if isinstance(values, str | bytes | Mapping | Set) or not isinstance(values, Iterable):
        raise fault(name, f"is {values!r}"[:80], "a list")
    return list(values)


def whole(name: str, value: Any, least: int = 1) -> int:
    """Return a whole number from `least` to the largest that solvers take as seeds."""
    if not isinstance(value, Integral) or not least <= int(value) < 2**31:
        raise fault(name, f"is {value!r}", f"a whole number from {least} to 2,147,483,647")
    return int(value)


def positive(name: str, value: Any, most: float = FARTHEST) -> float:
    """Return a number above 0, at most `most`."""
    if not isinstance(value, Real) or not 0.0 < float(value) <= most:
        raise fault(name, f"is {value!r}", f"a number above 0, at most {most:g}")
    return float(value)


def choice(name: str, value: object, known: Sequence[object]) -> None:
    """Refuse a value that is none of the known ones."""
    if value not in known:
        raise fault(name, f"is {value!r}", "one of " + ", ".join(map(repr, known)))
