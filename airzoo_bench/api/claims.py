"""What the answers of the three tracks have in common while they are collected."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api.arrays import in_order
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.ids import IMAGE_SUFFIXES
from airzoo_bench.core.validation import nearest
from airzoo_bench.geometry.precision import COARSEST_M

__all__ = ["Claims", "Fields", "coordinates", "index_of", "precise"]

Fields = Mapping[str, Any]


class Claims(Protocol):
    """The answers of one kind, collected one at a time."""

    def add(self, name: str, fields: Fields) -> None:
        """Check an answer and keep it.

        Raises
        ------
        UserError
            It cannot be scored; nothing of it is kept.
        """

    def missing(self) -> tuple[str, ...]:
        """Return the ids that have no answer yet."""

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the fields of the prediction file.

        Raises
        ------
        PredictionError
            The answers cannot be scored as a whole.
        """


def index_of(name: str, known: Mapping[str, int], what: str) -> int:
    """Return the row of an id.

    Raises
    ------
    PredictionError
        It is none; the nearest are offered.
    """
    if name in known:
        return known[name]
    shown = str(name)[:80]
    meant = _without_ending(shown, known)
    raise PredictionError(
        f"{shown!r} is no {what}{'' if meant else nearest(shown, list(known))}",
        expected=f"an id such as {next(iter(known), 'scene/name')}",
        fix=repr(meant) if meant else None,
    )


def _without_ending(name: str, known: Mapping[str, int]) -> str | None:
    """Return the one id that is meant by the name of a file, with or without its scene."""
    path = PurePosixPath(name)
    stem = str(path.with_suffix("")) if path.suffix.lower() in IMAGE_SUFFIXES else name
    meant = [one for one in known if one == stem or one.endswith(f"/{stem}")]
    return meant[0] if stem and len(meant) == 1 else None


def coordinates(field: str, values: ArrayLike, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Return numbers of a shape; None in it stands for any length.

    Raises
    ------
    PredictionError
        They are no numbers, or of another shape.
    """
    array = np.asarray(in_order(field, values))
    fits = array.ndim == len(shape) and all(
        want in (None, have) for want, have in zip(shape, array.shape, strict=True)
    )
    if array.dtype.kind not in "fiu" or not fits:
        sides = ", ".join("M" if want is None else str(want) for want in shape)
        raise PredictionError(
            f"{field} is {array.dtype} of shape {array.shape}",
            expected=f"numbers of shape ({sides}{',' * (len(shape) == 1)})",
        )
    return array


def precise(field: str, values: ArrayLike, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """Return finite coordinates, which may be millions of metres, in double precision.

    Raises
    ------
    PredictionError
        See `coordinates`; they are not finite, or of a type that does not keep hundredths of them.
    """
    given = coordinates(field, values, shape)
    array = given.astype(np.float64)
    if not np.isfinite(array).all():
        raise PredictionError(f"{field} is NaN or infinite in part", expected="finite numbers")
    largest = np.abs(array).max(initial=0.0)
    if given.dtype.kind == "f" and given.dtype.itemsize < array.itemsize:
        step = float(np.spacing(given.dtype.type(largest)))
        if step > COARSEST_M:
            raise PredictionError(
                f"{field} is {given.dtype}, which keeps {largest:.0f} to {step:.2g} only",
                expected="float64",
                fix=f"compute {field} in float64",
            )
    return array
