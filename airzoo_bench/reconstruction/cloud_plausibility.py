"""What a cloud looks like that lies elsewhere than its truth: units, degrees, axes, origins."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.alignment.similarity import Similarity

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

__all__ = ["lost_digits", "mirror_warning", "plausibility_warnings"]

_FACTOR = 80.0
"""A little below a hundred, so that outliers do not hide centimetres."""
_UNITS = ((1000.0, "millimetres"), (100.0, "centimetres"), (0.001, "kilometres"))
_UNIT_TOLERANCE = 2.0
_LONGEST_DEGREES = 5.0
_LARGEST = 1e30
_SMALLEST = 1e-30
_READ = 2000
# What C's and C++'s streams write unless told otherwise.
_FEWEST_DIGITS = 6
_TRIED = 2000
_POOR, _GOOD = 0.5, 0.6
_BETWEEN = "about the middle between it and the truth"


def plausibility_warnings(cloud: Floats, truth: Floats) -> tuple[str, ...]:
    """Say what a cloud may be instead, by its bounds (2, 3) and those of the truth."""
    if not (np.isfinite(cloud).all() and np.isfinite(truth).all()):
        return ()
    if _is_degrees(cloud, truth):
        return (
            "the cloud looks like longitude and latitude in degrees: it spans "
            f"{_spans(cloud)}, the truth {_spans(truth)}",
        )
    size, true_size = _diagonal(cloud), _diagonal(truth)
    if size > 0.0 and true_size > 0.0 and not 1 / _FACTOR < size / true_size < _FACTOR:
        return (_scale_warning(size / true_size, cloud, truth),)
    return _place_warning(cloud, truth, max(size, true_size))


def lost_digits(
    points: Floats, stored: np.dtype[Any], scale: float, tolerance: float
) -> str | None:
    """Say where coordinates lost digits before they came here."""
    finite = points[np.abs(points).max(axis=1, initial=0.0) < _LARGEST]
    if not len(finite):
        return None
    largest = np.abs(finite).max(axis=0)
    step, kept = _stated_step(finite[:_READ], largest, stored)
    error = float(np.sqrt((step * step).sum() / 12.0)) * scale
    if not error > tolerance:
        return None
    return (
        f"coordinates such as {float(largest.max()):.0f} are kept to {kept} only, steps of "
        f"{float(step.max()) * scale:.2g} m: an error of {error:.2g} m is to be expected; store "
        "float64, or all digits, or subtract an origin first"
    )


def _stated_step(points: Floats, largest: Floats, stored: np.dtype[Any]) -> tuple[Floats, str]:
    """Step (3,) between values that can be told apart at the largest, and what it comes from."""
    narrow = stored if stored.kind == "f" and stored.itemsize < 8 else np.dtype("f4")
    short = points.astype(narrow)
    fits = narrow == stored or bool((short == points).all())
    values = (short if fits else points).ravel()
    digits = max(max(map(_digits, values[values != 0]), default=0), _FEWEST_DIGITS)
    if digits <= _FEWEST_DIGITS + 1:
        place = np.floor(np.log10(np.maximum(largest, _SMALLEST))) + 1
        return 10.0 ** (place - digits), f"{digits} digits"
    if not fits:
        return np.zeros(3), ""
    return np.spacing(largest.astype(narrow)).astype(np.float64), narrow.name


def _digits(value: np.floating[Any]) -> int:
    """Count the digits of the shortest text that stands for a number."""
    text = np.format_float_scientific(value, trim="-")
    return len(text.partition("e")[0].replace(".", "").lstrip("-"))


def mirror_warning(
    cloud: Floats, truth: Floats, transform: Similarity, near: Iterable[float]
) -> str | None:
    """Say where a cloud (N, 3) would fit the truth (M, 3) if its axes were negated or exchanged."""
    from scipy.spatial import cKDTree

    if not (len(cloud) and len(truth)):
        return None
    some = cloud[:: max(1, len(cloud) // _TRIED)]
    tree = cKDTree(truth - truth[0])
    closest, *_ = limits = sorted(near)
    if _share_near(tree, some - truth[0], closest) > _POOR:  # as for nearly every cloud
        return None
    apart = np.median(truth, axis=0) - np.median(some, axis=0)
    others = list(_with_other_axes(some, transform, apart))
    # A cloud that is merely elsewhere would fit about as well without being mirrored.
    moved = np.array([words.endswith(_BETWEEN) for _, words in others])
    tried = [some, some + apart, *(points for points, _ in others)]
    for limit in limits:
        own, shifted, *rest = (_share_near(tree, points - truth[0], limit) for points in tried)
        least = np.maximum(_GOOD, 2 * np.where(moved, max(own, shifted), own))
        shares = np.where(rest >= least, rest, 0.0)
        best = int(np.argmax(shares))
        if own <= _POOR and shares[best]:
            return (
                f"the cloud looks mirrored or turned over: {own:.0%} of its points lie "
                f"within {limit:g} m of the truth, {shares[best]:.0%} with {others[best][1]}, "
                "though its cameras are aligned"
            )
    return None


def _share_near(tree: cKDTree, points: Floats, limit: float) -> float:
    away, _ = tree.query(points, distance_upper_bound=limit)
    return float(np.isfinite(away).mean())


def _with_other_axes(
    some: Floats, transform: Similarity, apart: Floats
) -> Iterator[tuple[Floats, str]]:
    """Yield points as they would lie with axes negated, then also exchanged, and what was done."""
    own, middle = transform.inverse().apply(some), np.median(some, axis=0)
    for order in itertools.permutations((0, 1, 2)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            words = _axes_in_words(order, signs)
            if words:
                at_origin = transform.apply(own[:, order] * signs)
                yield at_origin, f"{words} about the origin of its own frame"
                here = (some - middle)[:, order] * signs + middle
                yield here, f"{words} about its middle"
                if order == (0, 1, 2):
                    there = here + np.where(np.less(signs, 0.0), apart, 0.0)
                    yield there, f"{words} {_BETWEEN}"


def _axes_in_words(order: tuple[int, ...], signs: tuple[float, ...]) -> str:
    if order == (0, 1, 2):
        axes = " and ".join(axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0)
        return f"{axes} negated" if axes else ""
    read = ("-" * (sign < 0) + "xyz"[axis] for axis, sign in zip(order, signs, strict=True))
    return f"({', '.join(read)}) for (x, y, z)"


def _is_degrees(cloud: Floats, truth: Floats) -> bool:
    low, high = cloud[:, :2]
    within = bool((np.abs(cloud[:, :2]) <= (180.0, 180.0)).all())
    spans, true_spans = high - low, truth[1, :2] - truth[0, :2]
    small = 0.0 < spans.max() < _LONGEST_DEGREES and spans.max() * _FACTOR < true_spans.max()
    upright = _alike(cloud[1, 2] - cloud[0, 2], truth[1, 2] - truth[0, 2])
    return within and bool(small) and upright


def _alike(height: float, true_height: float) -> bool:
    # Heights stay metres where the horizontal coordinates are degrees.
    return height > 0.0 and true_height > 0.0 and 0.1 < height / true_height < 10.0


def _scale_warning(ratio: float, cloud: Floats, truth: Floats) -> str:
    off = f"{ratio:.3g} times as large as" if ratio > 1 else f"{1 / ratio:.3g} times smaller than"
    for factor, unit in _UNITS:
        if 1 / _UNIT_TOLERANCE < ratio / factor < _UNIT_TOLERANCE:
            return f"the cloud looks like {unit}: it is {off} the truth"
    return f"the cloud is {off} the truth: it spans {_spans(cloud)}, the truth {_spans(truth)}"


def _place_warning(cloud: Floats, truth: Floats, size: float) -> tuple[str, ...]:
    swapped = cloud[:, [1, 0, 2]]
    if not _overlap(cloud, truth) and _overlap(swapped, truth):
        return ("the cloud has x and y exchanged: with easting first it would lie on the truth",)
    away = float(np.linalg.norm(cloud.mean(axis=0) - truth.mean(axis=0)))
    if away > _FACTOR * size:
        return (
            f"the cloud lies {away:.6g} away from the truth, {away / max(size, 1e-300):.3g} times "
            "its size: another coordinate system, or a local origin that was subtracted",
        )
    return ()


def _overlap(one: Floats, other: Floats) -> bool:
    return bool((one[0] <= other[1]).all() and (other[0] <= one[1]).all())


def _diagonal(bounds: Floats) -> float:
    return float(np.linalg.norm(bounds[1] - bounds[0]))


def _spans(bounds: Floats) -> str:
    return " x ".join(f"{span:.4g}" for span in bounds[1] - bounds[0])
