"""Whether numbers have lost digits on their way into a file, and how far that moves a camera.

The centre of a camera is C = -R^T t. In projected coordinates t is millions of metres long, so that
a rotation without its ninth digit moves the camera by a centimetre.

Rounding to a step s is an error of s / sqrt(12), the standard deviation of a uniform distribution.
Entries of R that are off by e, independently, move the camera by e |t| once R is orthonormal again
(three of nine directions remain, one of which turns about t); entries of a quaternion move it by
sqrt(8) e |t|. All errors here are such root mean squares.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import matrix_to_quaternion

COARSEST_M = 0.01
"""The digits of an answer may move its camera by this much."""

_UNIFORM = 12.0**-0.5
_OF_QUATERNION = 8.0**0.5
# A number with more decimals of its leading digit fixes any camera on Earth to 0.1 mm.
_DECIMALS = 11
# Products of rotations that were computed in float64 are off by a few of its steps.
_EXACT = 1e-14
# So many times further from orthonormal than its digits explain, a rotation lost more before.
_BEYOND_CHANCE = 4.0
# So many bits are not 0 by chance: once in a thousand.
_CHANCE_BITS = 10
# Digits of quaternions that are looked for; 3e-9 moves a camera on Earth by 5 cm at most.
_RENORMALISED_DIGITS = range(3, 9)
_NARROW: tuple[type[np.floating[Any]], ...] = (np.float16, np.float32)


def was_rounded_to(values: Floats, kind: type[np.floating[Any]]) -> bool:
    """Tell numbers that went through float16 or float32 from numbers that merely fit it.

    Numbers of a lattice, such as whole pixels, use the last bit of the narrower type in one power
    of two only; those that were rounded to it use it in all. A few whole pixels may do so by
    chance: then few bits of the large ones are 0 that the lattice does not ask for.
    """
    with np.errstate(over="ignore"):
        if not (values.astype(kind) == values).all():
            return False
    bits = np.finfo(kind).nmant + 1
    mantissa, exponent = np.frexp(values[values != 0])
    whole = (np.abs(mantissa) * 2.0**bits).astype(np.int64)
    if len(np.unique(exponent[whole % 2 == 1])) < 2:
        return False
    lattice = (exponent + np.log2(whole & -whole)).min() - bits
    return bool(np.maximum(exponent - bits - lattice, 0).sum() >= _CHANCE_BITS)


def narrow_type(values: Floats) -> type[np.floating[Any]] | None:
    """Return float16 or float32 where numbers went through it, see `was_rounded_to`."""
    return next((kind for kind in _NARROW if was_rounded_to(values, kind)), None)


def rounding_errors(values: Floats) -> Floats:
    """Estimate by how much rounding to a narrow type or to few decimal digits has moved numbers.

    All are taken to be written in the same way; 0 where they have more digits than matter.
    """
    kind = narrow_type(values)
    if kind is not None:
        return _steps(values, kind) * _UNIFORM
    leading = np.ceil(np.log10(np.where(values == 0, 1.0, np.abs(values)))) - 1.0
    leading = np.clip(leading, -300.0, 300.0)  # powers that a double holds with room to spare
    digits = _fewest_decimals(values, 10.0**-leading)
    if digits is None or not values.any():
        return np.zeros_like(values)
    # Written with so many digits, or with so many decimals: the coarser of the two is the step.
    decimals = _fewest_decimals(values, np.ones_like(values))
    step = np.where(values == 0, 0.0, 10.0 ** (leading - digits))
    return np.maximum(step, 0.0 if decimals is None else 10.0**-decimals) * _UNIFORM


def pose_errors_m(rotations: Floats, translations: Floats, quaternions: Floats | None) -> Floats:
    """Estimate how far (N,) rounding has moved cameras with centres -R^T t.

    `rotations` (N, 3, 3) are as the file has them, or made of its `quaternions` (N, 4). The larger
    of two signs counts: the digits that the file keeps, and how far rotations are from orthonormal
    (or quaternions from unit length), which shows digits that were lost before.
    """
    if quaternions is None:
        product = np.swapaxes(rotations, 1, 2) @ rotations - np.eye(3)
        # The squares of the entries sum to 24 e^2: 4 e^2 on the diagonal, 2 e^2 off it.
        off = np.sqrt((product**2).sum(axis=(1, 2)) / 24.0)
        entries, weight = rotations.reshape(-1, 9), 1.0
    else:
        off = np.abs(np.sqrt((quaternions**2).sum(axis=1)) - 1.0)
        entries, weight = quaternions, _OF_QUATERNION
    # Rotations that few digits state exactly have lost nothing.
    if (off > _EXACT).any():
        kept = np.sqrt((rounding_errors(entries) ** 2).mean(axis=1))
        turned = np.where(off > _BEYOND_CHANCE * kept, off, kept)
    else:
        weight = _OF_QUATERNION
        unit = matrix_to_quaternion(rotations) if quaternions is None else quaternions
        turned = _renormalised_errors(unit)
    by_turn = weight * turned * np.sqrt((translations**2).sum(axis=1))
    moved = _translation_errors(rotations, translations)
    errors: Floats = np.hypot(by_turn, np.sqrt((moved**2).sum(axis=1)))
    return errors


def centre_errors_m(centres: Floats) -> Floats:
    """Estimate how far (N,) rounding has moved camera centres (N, 3) that are given as they are.

    Fewer than three may have few decimals by their nature, and those at one height may be places
    of a grid: their error is 0.
    """
    if len(np.unique(centres, axis=0)) < 3 or np.ptp(centres[:, 2]) == 0:
        return np.zeros(len(centres))
    errors: Floats = np.sqrt((rounding_errors(centres) ** 2).sum(axis=1))
    return errors


def _steps(values: Floats, digits: int | type[np.floating[Any]]) -> Floats:
    """Return the steps in which numbers of a narrow type, or of a number of decimals, go."""
    if isinstance(digits, int):
        return np.full_like(values, 10.0**-digits)
    return np.asarray(np.abs(np.spacing(values.astype(digits))), np.float64)


def _fewest_decimals(values: Floats, unit: Floats) -> int | None:
    """Count the decimals that all of values * unit are written with; None for many."""
    few = None
    for decimals in range(_DECIMALS, -1, -1):
        scaled = values * unit * 10.0**decimals
        if (np.abs(scaled - np.round(scaled)) > 1e-15 * np.maximum(np.abs(scaled), 1.0)).any():
            break
        few = decimals
    return few


def _translation_errors(rotations: Floats, translations: Floats) -> Floats:
    """Estimate errors (N, 3) of translations by their own digits.

    Turns by 90 degrees carry the centres over into t as they are, so that their plan is judged.
    Others are on no lattice: one of them shows which type they fit.
    """
    axes = np.round(rotations, 12)
    if np.isin(np.abs(axes), (0.0, 1.0)).all():
        centres = -np.einsum("nji,nj->ni", axes, translations)
        kind = narrow_type(centres[:, :2])
        return np.zeros_like(centres) if kind is None else _steps(centres, kind) * _UNIFORM
    errors = rounding_errors(translations)
    with np.errstate(over="ignore"):
        fit = [kind for kind in _NARROW if (translations.astype(kind) == translations).all()]
    return np.maximum(errors, _steps(translations, fit[0]) * _UNIFORM) if fit else errors


def _renormalised_errors(quaternions: Floats) -> Floats:
    """Estimate errors (N,) of unit quaternions that were normalised after they were rounded."""
    size = np.abs(quaternions)
    largest = size.max(axis=1, initial=0.0, keepdims=True)
    # Rows of one size, such as those of nadir, are the same at any number of digits.
    rows = np.flatnonzero(((size > 1e-6) & (size < largest - 1e-6)).any(axis=1))
    for digits in (*_NARROW, *_RENORMALISED_DIGITS) if len(rows) else ():
        step = _steps(largest[rows], digits)
        whole = np.round(largest[rows] / step) + np.array((-1.0, 0.0, 1.0))[:, None, None]
        scaled = size[rows] * (whole * step / largest[rows])
        step = _steps(scaled, digits)
        off = np.abs(scaled - np.round(scaled / step) * step)
        if (off < 1e-6 * step + 1e-15).all(axis=2).any(axis=0).all():
            errors: Floats = np.sqrt((_steps(size, digits) ** 2).mean(axis=1)) * _UNIFORM
            return errors
    return np.zeros(len(size))
