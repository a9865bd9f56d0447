"""Telling the person who waits how far the work is, without printing in library code."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

__all__ = ["Progress", "silent"]

T = TypeVar("T")


class Progress(Protocol):
    """Wraps an iteration so that it is shown while it runs."""

    def __call__(self, items: Iterable[T], label: str, total: int) -> Iterator[T]:
        """Yield the items, showing `label` and how many of `total` are done."""


def silent(items: Iterable[T], label: str, total: int) -> Iterator[T]:
    """Yield the items and show nothing."""
    del label, total
    yield from items
