"""How far work is, as bars on a terminal: one display, since work may consist of work."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, Task, TextColumn
from rich.progress import TimeRemainingColumn as TimeLeft
from rich.text import Text

__all__ = ["bar"]

T = TypeVar("T")

_display: list[Progress] = []


def bar(items: Iterable[T], label: str, total: int, *, rate: bool = False) -> Iterator[T]:
    """Yield the items and show how many are done, how fast where asked, and the time left.

    The label is printable.
    """
    with _bars() as bars:
        known = total if total > 1 else None  # one piece of work is never half done: it pulses
        row = bars.add_task(label, total=known, rate=rate)
        try:
            yield from bars.track(items, total=known, task_id=row)
        finally:
            bars.remove_task(row)


@contextmanager
def _bars() -> Iterator[Progress]:
    """Return the display on the terminal, to which a row is added for each work under way."""
    if _display:
        yield _display[0]
        return
    name = TextColumn("{task.description}", markup=False)
    columns = (name, BarColumn(), MofNCompleteColumn(), _Rate(""), TimeLeft())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        _display.append(bars)
        try:
            yield bars
        finally:
            _display.clear()


class _Rate(TextColumn):
    """How many are done a second, of rows that show it."""

    def render(self, task: Task) -> Text:
        """Return the cell of a row."""
        return Text(f"{task.speed:.3g}/s" if task.fields["rate"] and task.speed else "")
