"""What is said of long work where no bar can be drawn."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from threading import Event
from typing import TypeVar

from airzoo_bench.core.progress import Headed, report_progress, with_progress
from tests.support import HANGS_S

T = TypeVar("T")


def clock(*seconds: float) -> Iterator[float]:
    return iter(seconds)


def test_a_line_every_half_minute() -> None:
    times = clock(0, 10, 29, 31, 40, 70, 80)
    said: list[str] = []
    items = report_progress("abcdef", "poses", 6, say=said.append, clock=lambda: next(times))
    assert list(items) == list("abcdef")
    # After 31 s three of six are done, after 70 s five; the lines between come too soon.
    assert [line.partition(",")[0] for line in said] == ["poses: 3 of 6", "poses: 5 of 6"]
    assert [line.rpartition("about ")[2] for line in said] == ["31 s left", "14 s left"]


def test_minutes_and_hours() -> None:
    for second, words in ((240.0, "4 min"), (7200.0, "2 h")):
        times = clock(0, second, second)
        said: list[str] = []
        list(
            report_progress(
                "ab", "cells", 2, say=said.append, clock=lambda times=times: next(times)
            )
        )
        assert said[0].endswith(f"about {words} left")


def test_work_under_way_is_named_before_its_first_item_is_done() -> None:
    said: list[str] = []
    named = Event()

    def say(line: str) -> None:
        said.append(line)
        named.set()

    def slowly() -> bool:
        return named.wait(HANGS_S)

    def soon(items: Iterable[T], label: str, total: int) -> Iterator[T]:
        return report_progress(items, label, total, say=say, first_s=0.01)

    assert with_progress(slowly, "learning the words", Headed("city", soon))
    assert said == ["city: learning the words ..."]
