"""How far work is, as bars on a terminal: one display, since work may consist of work."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.progress import TimeRemainingColumn as TimeLeft

T = TypeVar("T")

_display: list[Progress] = []


def bar(items: Iterable[T], label: str, total: int) -> Iterator[T]:
    """Yield the items and show how many are done, and the time left.

    The label is printable.
    """
    is_first = not _display
    if is_first:
        name = TextColumn("{task.description}", markup=False)
        columns = (name, BarColumn(), MofNCompleteColumn(), TimeLeft())
        _display.append(Progress(*columns, console=Console(stderr=True), transient=True))
        _display[0].start()
    bars = _display[0]
    known = total if total > 1 else None  # one piece of work is never half done: it pulses
    row = bars.add_task(label, total=known)
    try:
        yield from bars.track(items, total=known, task_id=row)
    finally:
        bars.remove_task(row)
        if is_first:
            bars.stop()
            _display.clear()
