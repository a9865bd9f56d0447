"""What a cloud looks like that lies elsewhere than its truth: units, degrees, axes, origins."""

from __future__ import annotations

from typing import Any

import numpy as np

from airzoo_bench.geometry.arrays import Floats

__all__ = ["precision_suspicion", "suspicions"]

_FACTOR = 80.0
"""A little below a hundred, so that outliers do not hide centimetres."""
_UNITS = ((1000.0, "millimetres"), (100.0, "centimetres"), (0.001, "kilometres"))
_UNIT_TOLERANCE = 2.0
_LONGEST_DEGREES = 5.0
_COARSEST = 0.01


def suspicions(cloud: Floats, truth: Floats) -> tuple[str, ...]:
    """Say what a cloud may be instead, by its bounds and those of the truth.

    Only for clouds that are meant to lie where the truth lies: before an alignment with scale, any
    scale and place is right.

    Parameters
    ----------
    cloud, truth : (2, 3) float64 arrays
        Smallest and largest coordinates; robust ones (percentiles) see through outliers.

    Returns
    -------
    tuple of str
        Warnings; empty where nothing is suspicious. Bounds that are not finite tell nothing.
    """
    if not (np.isfinite(cloud).all() and np.isfinite(truth).all()):
        return ()
    if _is_degrees(cloud, truth):
        return (
            "the cloud looks like longitude and latitude in degrees: it spans "
            f"{_spans(cloud)}, the truth {_spans(truth)}",
        )
    size, true_size = _diagonal(cloud), _diagonal(truth)
    if size > 0.0 and true_size > 0.0 and not 1 / _FACTOR < size / true_size < _FACTOR:
        return (_scale_suspicion(size / true_size, cloud, truth),)
    return _place_suspicion(cloud, truth, max(size, true_size))


def precision_suspicion(bounds: Floats, precision: np.dtype[Any]) -> str | None:
    """Say where coordinates are stored too coarsely: float32 keeps 5,000,000 m to half a metre.

    Parameters
    ----------
    bounds : (2, 3) float64 array
    precision : dtype
        Type that the coordinates were stored in.
    """
    largest = float(np.abs(bounds).max()) if np.isfinite(bounds).all() else 0.0
    if precision.kind != "f" or precision.itemsize >= 8:
        return None
    step = largest * float(np.finfo(precision).eps)
    if step <= _COARSEST:
        return None
    return (
        f"coordinates such as {largest:.0f} are stored as {precision.name}, which keeps them to "
        f"{step:.2g} only: store float64, or subtract an origin in float64 first"
    )


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


def _scale_suspicion(ratio: float, cloud: Floats, truth: Floats) -> str:
    off = f"{ratio:.3g} times as large as" if ratio > 1 else f"{1 / ratio:.3g} times smaller than"
    for factor, unit in _UNITS:
        if 1 / _UNIT_TOLERANCE < ratio / factor < _UNIT_TOLERANCE:
            return f"the cloud looks like {unit}: it is {off} the truth"
    return f"the cloud is {off} the truth: it spans {_spans(cloud)}, the truth {_spans(truth)}"


def _place_suspicion(cloud: Floats, truth: Floats, size: float) -> tuple[str, ...]:
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
