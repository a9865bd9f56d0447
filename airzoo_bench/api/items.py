"""Sequences whose items are made when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Generic, TypeVar, overload

__all__ = ["Items"]

T = TypeVar("T", covariant=True)


class Items(Sequence[T], Generic[T]):
    """Photos, tiles or crops of a scene: each is made when it is asked for, and none is kept.

    Parameters
    ----------
    what : str
        Such as ``"tiles of city"``.
    count : int
    make : callable
        Takes a number from 0 to `count` and returns the item.

    Examples
    --------
    >>> items = Items("tiles of city", 3, lambda row: f"tile {row}")
    >>> items, items[-1], list(items[:2])
    (<3 tiles of city>, 'tile 2', ['tile 0', 'tile 1'])
    """

    def __init__(self, what: str, count: int, make: Callable[[int], T]) -> None:
        self._what, self._count, self._make = what, count, make

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[T]:
        return map(self._make, range(self._count))

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> Items[T]: ...
    def __getitem__(self, index: int | slice) -> T | Items[T]:
        rows = range(self._count)[index]
        if isinstance(rows, int):
            return self._make(rows)
        return Items(f"of the {self._what}", len(rows), lambda row: self._make(rows[row]))

    def __repr__(self) -> str:
        return f"<{self._count:,} {self._what}>"
