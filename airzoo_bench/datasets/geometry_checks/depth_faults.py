"""Which fault of depth, pose or camera explains the depth errors.

To first order the error e = n . X - 1 of a point X in the target's frame, on its surface n, changes
linearly with what is wrong. With source points x, X = R x + t, and m = R^T n:

==========================  =======================  =========================
stated value is             source frame             target frame
==========================  =======================  =========================
depth too long by share s   + s m . x                - s n . X
camera turned by w (rad)    - w . (x  x  m)          + w . (X  x  n)
centre shifted by c (m)     + c . m                  - c . n
focal too long by share f   - f m . (x, y, 0)        + f n . (X, Y, 0)
principal point off by p    - p . (mx, my) z         + p . (nx, ny) Z
==========================  =======================  =========================

w and c are in the camera's own axes, p is in focal lengths; "turned" means that the stated rotation
is exp(w) times the true one. Each fault is fitted alone, by a regression that outliers do not steer
(Huber 1964), with an error that allows for errors shared within a pair (clustered sandwich). The
one that leaves least is the explanation, if it is there beyond doubt.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from airzoo_bench.datasets.geometry_checks.depth_consistency import Comparison
from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = ["COLUMNS", "Explanation", "FaultKind", "design_rows", "explain"]

COLUMNS = 10
"""Of a design: scale; turn about x, y, z; shift along x, y, z; focal; principal point x, y."""

_LEAST_ROWS = 100
_LEAST_BETTER = 0.01
_LEFT = 0.75
_STEPS = 15
_HUBER = 1.345
_MAD_TO_SIGMA = 1.4826
_SURE = 6.0  # standard errors
_UNSEEN = 5e-3  # errors change by less than this share of the fault: it is not to be seen
_FLOOR = 1e-7  # of the spread of errors: depths are float32
_GROSS = 0.02  # a larger error says that something is wrong, not how much


class FaultKind(StrEnum):
    """What may be wrong with a frame, or with all."""

    SCALE = "scale"
    TURN = "turn"
    SHIFT = "shift"
    FOCAL = "focal"
    CENTRE = "centre"


_PARTS = {
    FaultKind.SCALE: slice(0, 1),
    FaultKind.TURN: slice(1, 4),
    FaultKind.SHIFT: slice(4, 7),
    FaultKind.FOCAL: slice(7, 8),
    FaultKind.CENTRE: slice(8, 10),
}


@dataclass(frozen=True, eq=False)
class Explanation:
    """A fault that explains depth errors.

    Attributes
    ----------
    kind : FaultKind
    values : (1,), (2,) or (3,) float64
        Share of depth or focal length; radians about, or metres along, the camera's x, y and z;
        pixels of the principal point.
    uncertainty : float
        Standard error, in the same unit.
    explained : float
        By how much the mean error falls when the fault is taken away, as a share.
    """

    kind: FaultKind
    values: Floats
    uncertainty: float
    explained: float

    def describe(self) -> str:
        """Say it in words, after "is" or "are"."""
        size, off = _length(self.values), self.uncertainty
        axis = ", ".join(f"{value:+.2f}" for value in self.values / max(size, 1e-300))
        sign = "long" if self.values[0] > 0.0 else "short"
        match self.kind:
            case FaultKind.SCALE:
                return f"{100 * size:.2f} % too {sign} in depth (± {100 * off:.2f} %)"
            case FaultKind.TURN:
                turn, off = np.degrees(size), np.degrees(off)
                return f"turned by {turn:.3f}° (± {off:.3f}°) about the axis ({axis}) of the camera"
            case FaultKind.SHIFT:
                return f"{size:.3f} m (± {off:.3f} m) off, along ({axis}) of the camera"
            case FaultKind.FOCAL:
                return f"{100 * size:.2f} % too {sign} in focal length (± {100 * off:.2f} %)"
            case FaultKind.CENTRE:
                x, y = self.values
                return f"off by {x:+.2f}, {y:+.2f} px in the principal point (± {off:.2f} px)"


def design_rows(comparison: Comparison, turn: Floats, count: int) -> tuple[Floats, Floats, Floats]:
    """Lay out the regression of the first points of a comparison (they are in random order).

    Parameters
    ----------
    comparison : Comparison
    turn : (3, 3) array
        R, from the source's camera frame to the target's.
    count : int
        How many points.

    Returns
    -------
    error : (m,) array
    source, target : (m, 10) arrays
        How the error changes with faults of either frame.
    """
    n, x = comparison.surface[:count], comparison.points[:count]
    source = _columns(n @ turn, x)
    return comparison.error[:count], source, -_columns(n, comparison.projected[:count])


def explain(
    error: Floats, design: Floats, pair: Ints, typical_depth_m: float, typical_focal_px: float
) -> Explanation | None:
    """Find the one fault that explains depth errors best.

    Parameters
    ----------
    error : (m,) array
    design : (m, 10) array
        See `COLUMNS`.
    pair : (m,) int array
        Which pair of frames each is from.
    typical_depth_m, typical_focal_px : float
        Shifts and principal points are held against them.

    Returns
    -------
    Explanation or None
        None where no fault is beyond doubt (6 standard errors), large enough to matter (see
        `_limits`) and of help (a quarter of the mean error, and in 1 % of the rows, at least 100,
        half of the error goes with it: a few points at edges are no evidence); and where errors
        are too large for a linear model (median above 2 %).
    """
    if len(error) < _LEAST_ROWS or float(np.median(np.abs(error))) > _GROSS:
        return None
    before = _spread(error)
    units = {FaultKind.SHIFT: typical_depth_m, FaultKind.CENTRE: typical_focal_px}
    found: list[tuple[float, Explanation]] = []
    for kind, limit in _limits(typical_focal_px).items():
        columns = design[:, _PARTS[kind]] * (typical_depth_m if kind is FaultKind.SHIFT else 1.0)
        values, uncertainty = _fit(error, columns, pair)
        residual = error - _product(columns, values)
        left = _spread(residual)
        if _length(values) >= max(limit, _SURE * uncertainty) and _helps(error, residual):
            unit = units.get(kind, 1.0)
            fault = Explanation(kind, values * unit, uncertainty * unit, 1.0 - left / before)
            found.append((left, fault))
    return min(found, key=lambda item: item[0])[1] if found else None


def _limits(focal_px: float) -> dict[FaultKind, float]:
    """Return the least fault that is named: half of what must not pass (0.2 %, 0.1°, 0.5 px).

    A shift is named from where it moves a point as far as that scale does.
    """
    return {
        FaultKind.SCALE: 1e-3,
        FaultKind.TURN: float(np.radians(0.05)),
        FaultKind.SHIFT: 1e-3,
        FaultKind.FOCAL: 1e-3,
        FaultKind.CENTRE: 0.25 / focal_px,
    }


def _helps(error: Floats, residual: Floats) -> bool:
    better = np.abs(residual) < 0.5 * np.abs(error) - 10 * _FLOOR
    enough = better.sum() >= max(_LEAST_ROWS, _LEAST_BETTER * len(error))
    return bool(enough) and _spread(residual) <= _LEFT * _spread(error)


def _columns(n: Floats, x: Floats) -> Floats:
    """How n . x changes with each fault of the frame that x is from, (m, 10)."""
    scale = (n * x).sum(axis=1, keepdims=True)
    focal = -(n[:, :2] * x[:, :2]).sum(axis=1, keepdims=True)
    return np.concatenate((scale, -np.cross(x, n), n, focal, -n[:, :2] * x[:, 2:]), axis=1)


def _length(values: Floats) -> float:
    return float(np.sqrt((values * values).sum()))


def _spread(error: Floats) -> float:
    return float(np.minimum(np.abs(error), _GROSS).mean())


def _fit(error: Floats, design: Floats, pair: Ints) -> tuple[Floats, float]:
    """Regress with Huber's weights; parameters that hardly change the errors stay zero."""
    visible = _visible(design)
    if not visible.size:
        return np.zeros(design.shape[1]), np.inf
    columns = np.stack([_product(design, way) for way in visible.T], axis=1)
    values: Floats = np.zeros(columns.shape[1])
    limit = np.inf
    for _ in range(_STEPS):
        residual = error - _product(columns, values)
        limit = _HUBER * _MAD_TO_SIGMA * max(float(np.median(np.abs(residual))), _FLOOR)
        weight = np.minimum(1.0, limit / np.maximum(np.abs(residual), _FLOOR))
        weighted = columns * weight[:, None]
        values = np.linalg.pinv(_gram(columns, weighted)) @ (weighted * error[:, None]).sum(axis=0)
    residual = error - _product(columns, values)
    covariance = _clustered(residual, columns, limit, pair)
    return visible @ values, float(np.sqrt(np.trace(covariance)))


def _visible(design: Floats) -> Floats:
    """Return orthonormal directions (k, v) of the parameters that change the errors."""
    power, directions = np.linalg.eigh(_gram(design, design) / len(design))
    return directions[:, power > _UNSEEN**2]


def _clustered(residual: Floats, columns: Floats, limit: float, pair: Ints) -> Floats:
    score = columns * np.clip(residual, -limit, limit)[:, None]
    order = np.argsort(pair, kind="stable")
    starts = np.flatnonzero(np.diff(pair[order], prepend=-1))
    sums = np.add.reduceat(score[order], starts, axis=0)
    inner = columns[np.abs(residual) <= limit]
    bread = np.linalg.pinv(_gram(inner, inner))
    return bread @ _gram(sums, sums) @ bread


def _gram(a: Floats, b: Floats) -> Floats:
    """Return a^T b, summed column by column: the rounding of BLAS varies with its threads."""
    return np.array([[(x * y).sum() for y in b.T] for x in a.T])


def _product(columns: Floats, values: Floats) -> Floats:
    product: Floats = (columns * values).sum(axis=1)
    return product
