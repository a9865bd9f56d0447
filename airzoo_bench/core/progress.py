"""Telling the person who waits how far the work is, without printing in library code."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from time import monotonic
from typing import Protocol, TypeVar

__all__ = ["Progress", "silent", "told"]

T = TypeVar("T")

_EVERY_S = 30.0


class Progress(Protocol):
    """Wraps an iteration so that it is shown while it runs."""

    def __call__(self, items: Iterable[T], label: str, total: int) -> Iterator[T]:
        """Yield the items, showing `label` and how many of `total` are done."""


def silent(items: Iterable[T], label: str, total: int) -> Iterator[T]:
    """Yield the items and show nothing."""
    del label, total
    yield from items


def told(
    items: Iterable[T],
    label: str,
    total: int,
    *,
    say: Callable[[str], None],
    clock: Callable[[], float] = monotonic,
) -> Iterator[T]:
    """Yield the items and say every half minute how many are done and how long the rest takes.

    Parameters
    ----------
    items, label, total
        See `Progress`.
    say : callable
        Takes a line of text.
    clock : callable
        Seconds since whenever.
    """
    begin = last = clock()
    for done, item in enumerate(items, 1):
        yield item
        now = clock()
        if now - last >= _EVERY_S and done < total:
            left = (now - begin) / done * (total - done)
            say(f"{label}: {done:,} of {total:,}, about {_duration(left)} left")
            last = now


def _duration(seconds: float) -> str:
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"
