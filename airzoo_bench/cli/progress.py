"""Lines that say how far long work is, for a log or a pipe, which have no bars."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from threading import Timer
from time import monotonic
from typing import TypeVar

T = TypeVar("T")
_FEW = 3  # items, the first of which are slower than the rest, tell nothing of it


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
