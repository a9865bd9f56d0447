"""Scores of a ranking from distances on the ground, where a near miss is better than a far one.

Throughout, ``distances_m`` is (Q, K), best rank first: metres from the centre of the query's
footprint to the centre of the ranked tile, infinite where there is no tile or the predictions
lack the query. A list shorter than k is filled with infinite distances.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.geometry.arrays import Floats

__all__ = ["dis_at", "is_within", "pdm_at", "sdm_at", "top1_distance"]


def top1_distance(distances_m: Floats) -> Floats:
    """Distance of the first tile.

    Parameters
    ----------
    distances_m : (Q, K) float64
        From the query to the tile at each rank, in metres.

    Returns
    -------
    (Q,) float64
        Metres; infinite where nothing was ranked.

    Raises
    ------
    ValueError
        `distances_m` is not a matrix, or holds NaN.
    """
    first = _first(distances_m, 1)
    return first[:, 0].copy() if first.shape[1] else np.full(len(first), np.inf)


def is_within(top1_m: Floats, limit_m: float) -> Floats:
    """1 where the first tile is nearer than the limit, strictly; else 0.

    Parameters
    ----------
    top1_m : (Q,) float64
        Metres, from `top1_distance`.
    limit_m : float
        Metres.

    Returns
    -------
    (Q,) float64
        1 or 0.

    References
    ----------
    MA@m of DenseUAV: Dai et al., Vision-Based UAV Self-Positioning in Low-Altitude Urban
    Environments, arXiv:2201.09201; ``evaluateDistance.py`` of Dmmm1997/DenseUAV.
    """
    return (top1_m < limit_m).astype(np.float64)


def sdm_at(distances_m: Floats, k: int, scale: float) -> Floats:
    r"""SDM@k, the spatial distance metric: how near the first k tiles are, early ranks more.

    .. math:: \frac{\sum_{i \le k} (k - i + 1)\, e^{-s d_i}}{\sum_{i \le k} (k - i + 1)}

    Parameters
    ----------
    distances_m : (Q, K) float64
        From the query to the tile at each rank, in metres.
    k : int
        At least 1.
    scale : float
        s, above 0, per unit of the distances: Game4Loc has 0.001 per metre. DenseUAV has 5000 per
        degree, on differences of longitude and latitude taken alike (0.045 per metre along a
        meridian); see `positions.degrees_apart`.

    Returns
    -------
    (Q,) float64
        1 where all of the first k tiles are at distance 0.

    Raises
    ------
    ValueError
        `distances_m` is not a matrix or holds NaN, k is below 1, or the scale is not above 0.

    References
    ----------
    Dai et al., Vision-Based UAV Self-Positioning in Low-Altitude Urban Environments,
    arXiv:2201.09201 (DenseUAV); ``sdm`` in ``game4loc/evaluate/gta.py`` of Yux1angJi/GTA-UAV.
    """
    _check_positive("scale", scale)
    return _rank_weighted_mean(_first(distances_m, k), k, lambda d: np.exp(-scale * d))


def dis_at(distances_m: Floats, k: int, worst_m: Floats) -> Floats:
    """Dis@k of Game4Loc: the mean distance of the first k tiles.

    Parameters
    ----------
    distances_m : (Q, K) float64
        From the query to the tile at each rank, in metres.
    k : int
        At least 1.
    worst_m : (Q,) float64
        Distance to the farthest tile of the gallery, which stands for ranks without a tile: a
        short list gains nothing, and the mean over queries stays finite.

    Returns
    -------
    (Q,) float64
        Metres.

    Raises
    ------
    ValueError
        `distances_m` is not a matrix or holds NaN, or k is below 1.

    References
    ----------
    ``get_dis`` in ``game4loc/evaluate/gta.py`` of Yux1angJi/GTA-UAV.
    """
    first = _first(distances_m, k)
    total: Floats = (k - first.shape[1]) * worst_m
    for column in first.T:
        total += np.where(np.isfinite(column), column, worst_m)
    return total / k


def pdm_at(
    distances_m: Floats, k: int, *, tile_size_m: ArrayLike, steepness: float, tolerance: float
) -> Floats:
    r"""PDM@k of AnyVisLoc: as SDM@k, with distances in tiles and a gain that falls as a sigmoid.

    .. math:: \frac{\sum_{i \le k} (k - i + 1)\, f(d_i / w_i)}{\sum_{i \le k} (k - i + 1)},
        \quad f(r) = \frac{1}{1 + e^{\lambda (r - \alpha)}}

    The authors' code divides by the weights of the ranks that are there; here a list shorter than
    k has lost those ranks. A tile at distance 0 has f(0), not 1 (0.995 for their parameters).

    Parameters
    ----------
    distances_m : (Q, K) float64
        From the query to the tile at each rank, in metres.
    k : int
        At least 1.
    tile_size_m : float, (Q, 1) or (Q, K)
        w, the side of the tile on the ground in metres, above 0 (whatever stands where there is
        no tile must be so too).
    steepness : float
        :math:`\lambda`, above 0: the authors' code has 6.
    tolerance : float
        :math:`\alpha`, the distance in tiles where the gain is one half: their code has 0.9.

    Returns
    -------
    (Q,) float64
        0 to 1.

    Raises
    ------
    ValueError
        `distances_m` is not a matrix or holds NaN, the sizes do not fit it, k is below 1, or a
        size or the steepness is not above 0.

    References
    ----------
    Ye et al., Exploring the best way for UAV visual localization under Low-altitude Multi-view
    Observation Condition: a Benchmark, arXiv:2503.10692; ``retrieval_metrics_from_ratios`` in
    ``run_avl_retrieval_only.py`` of UAV-AVL/Benchmark.
    """
    _check_positive("tile_size_m", tile_size_m)
    _check_positive("steepness", steepness)
    first = _first(distances_m, k)
    sizes = np.broadcast_to(np.asarray(tile_size_m, dtype=np.float64), distances_m.shape)
    return _rank_weighted_mean(
        first / sizes[:, :k], k, lambda ratio: _falling_sigmoid(steepness * (ratio - tolerance))
    )


def _falling_sigmoid(x: Floats) -> Floats:
    with np.errstate(over="ignore"):  # exp overflows to infinity, and the gain is rightly 0
        return 1 / (1 + np.exp(x))


def _rank_weighted_mean(values: Floats, k: int, gain: Callable[[Floats], Floats]) -> Floats:
    # One rank after the other: the sum has one order, whatever the layout or the BLAS.
    total = np.zeros(len(values))
    for weight, column in zip(range(k, 0, -1), values.T, strict=False):
        total += weight * gain(column)
    return total / (k * (k + 1) / 2)


def _first(distances_m: Floats, k: int) -> Floats:
    if distances_m.ndim != 2:
        raise ValueError(f"distances_m has shape {distances_m.shape}, expected (Q, K)")
    if k < 1:
        raise ValueError(f"k is {k}, expected at least 1")
    first = distances_m[:, :k]
    if np.isnan(first).any():
        raise ValueError("distances_m holds NaN, expected infinity where there is no tile")
    return first


def _check_positive(name: str, value: ArrayLike) -> None:
    if not (np.asarray(value) > 0).all():
        raise ValueError(f"{name} is not above 0")
