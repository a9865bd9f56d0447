"""How far long work is, for whoever shows it: library code prints nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol, TypeVar

T = TypeVar("T")


class Progress(Protocol):
    """Wraps an iteration so that it is shown while it runs."""

    def __call__(self, items: Iterable[T], label: str, total: int) -> Iterator[T]:
        """Yield the items, showing `label` and how many of `total` are done."""


def silent(items: Iterable[T], label: str, total: int) -> Iterator[T]:
    """Yield the items and show nothing."""
    return iter(items)


@dataclass(frozen=True)
class Headed:
    """Shows work with a heading before each label, such as the scene that it is done for."""

    heading: str
    progress: Progress

    def __call__(self, items: Iterable[T], label: str, total: int) -> Iterator[T]:
        """See `Progress`."""
        return self.progress(items, f"{self.heading}: {label}", total)


def with_progress(work: Callable[[], T], label: str, progress: Progress) -> T:
    """Do work that is one piece, and show while it lasts what it is."""
    (result,) = progress((work() for _ in range(1)), label, 1)
    return result
