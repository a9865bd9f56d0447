"""What is said of long work where no bar can be drawn."""

from __future__ import annotations

from collections.abc import Iterator

from airzoo_bench.core.progress import told


def clock(*seconds: float) -> Iterator[float]:
    return iter(seconds)


def test_a_line_every_half_minute() -> None:
    times = clock(0, 10, 29, 31, 40, 70, 80)
    said: list[str] = []
    items = told("abcdef", "poses", 6, say=said.append, clock=lambda: next(times))
    assert list(items) == list("abcdef")
    # After 31 s three of six are done, after 70 s five; the lines between come too soon.
    assert said == ["poses: 3 of 6, about 31 s left", "poses: 5 of 6, about 14 s left"]


def test_short_work_is_done_in_silence() -> None:
    times = clock(0, 10, 20, 60)
    said: list[str] = []
    assert len(list(told("abc", "poses", 3, say=said.append, clock=lambda: next(times)))) == 3
    assert said == []  # what is done needs no word


def test_minutes_and_hours() -> None:
    for second, words in ((240.0, "4 min"), (7200.0, "2 h")):
        times = clock(0, second, second)
        said: list[str] = []
        list(told("ab", "cells", 2, say=said.append, clock=lambda times=times: next(times)))
        assert said == [f"cells: 1 of 2, about {words} left"]
