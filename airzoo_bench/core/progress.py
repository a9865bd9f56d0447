"""How far long work is, for whoever shows it: library code prints nothing."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass
from threading import Timer
from time import monotonic
from typing import Protocol, TypeVar

T = TypeVar("T")
_FEW = 3  # items, the first of which are slower than the rest, tell nothing of it


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


def report_progress(
    items: Iterable[T],
    label: str,
    total: int,
    *,
    say: Callable[[str], None],
    clock: Callable[[], float] = monotonic,
    first_s: float = 2.0,
    every_s: float = 30.0,
) -> Generator[T, None, None]:
    """Yield the items; name what takes long, and say now and then how long the rest takes."""
    name, begin = Timer(first_s, say, [f"{label} ..."]), clock()
    name.daemon, last = True, begin
    name.start()
    try:
        for done, item in enumerate(items, 1):
            yield item
            now = clock()
            if now - last >= every_s and done < total:
                left = (now - begin) / done * (total - done)
                rest = f"{left / 60:,.0f} min" if left >= 90 else f"{max(left, 10):.0f} s"
                known = f", about {rest} left" * (done >= _FEW)
                say(f"{label}: {done:,} of {total:,}{known}")
                last = now
    finally:
        name.cancel()
