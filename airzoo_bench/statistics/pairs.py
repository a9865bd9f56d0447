"""Which pairs of many variables are asked for, and in which order they are taken."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

__all__ = ["Places", "Wanted", "hubs", "oriented", "rows_of", "wanted_pairs"]

Places = NDArray[np.intp]
"""Variables, by their numbers."""
Wanted = NDArray[np.bool_]
"""Which pairs are asked for (V, V), above the diagonal alone."""


def wanted_pairs(count: int, chosen: Places | None) -> Wanted:
    """Return which pairs have a chosen variable.

    Parameters
    ----------
    count : int
        Of variables.
    chosen : (C,) array of int or None
        None: all.

    Returns
    -------
    (V, V) bool
        True above the diagonal alone.
    """
    wanted = np.ones((count, count), np.bool_)
    if chosen is not None:
        wanted[:] = False
        wanted[chosen], wanted[:, chosen] = True, True
    return np.triu(wanted, 1)


def rows_of(wanted: Wanted) -> Iterator[tuple[int, Places]]:
    """Yield each wanted pair once: a variable with others, which are all higher or all lower.

    Where a few variables are in all pairs, each of these has its pairs together.

    Parameters
    ----------
    wanted : (V, V) bool
        From `wanted_pairs`.

    Yields
    ------
    tuple of int and (C,) array of int
        With at least one other; see `oriented`.
    """
    chosen, rest = hubs(wanted), wanted.copy()
    rest[chosen] = False
    for one in chosen.tolist():
        above, below = np.flatnonzero(wanted[one]), np.flatnonzero(rest[:, one])
        yield from ((one, others) for others in (above, below) if len(others))


def oriented(one: int, others: Places) -> tuple[int, Places] | tuple[Places, int]:
    """Put the lower side of pairs first, where rounding depends on which one comes first.

    Parameters
    ----------
    one, others : int, (C,) array of int
        From `rows_of`.

    Returns
    -------
    tuple of int and (C,) array of int
        In either order.
    """
    return (one, others) if others[0] > one else (others, one)


def hubs(wanted: Wanted) -> Places:
    """Return variables of which every wanted pair has one: few where few were chosen.

    Parameters
    ----------
    wanted : (V, V) bool
        From `wanted_pairs`.

    Returns
    -------
    (C,) array of int
        Ascending.
    """
    both = wanted | wanted.T
    count = both.sum(axis=1)
    most = np.flatnonzero(count == count.max())
    rest = both.copy()
    rest[most], rest[:, most] = False, False
    return np.flatnonzero(both.any(axis=1)) if rest.any() else most
