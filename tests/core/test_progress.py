"""Lines about long work where no bar can be drawn."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from threading import Event
from typing import TypeVar

from airzoo_bench.core.progress import Headed, report_progress, with_progress
from tests.support import HANGS_S

T = TypeVar("T")


def test_a_line_every_half_minute() -> None:
    times, said = iter((0, 10, 29, 31, 40, 210, 220)), list[str]()
    items = report_progress("abcdef", "poses", 6, say=said.append, clock=lambda: next(times))
    assert list(items) == list("abcdef")
    # After 31 s three of six are done, after 210 s five; the lines between come too soon.
    assert [line.partition(",")[0] for line in said] == ["poses: 3 of 6", "poses: 5 of 6"]
    assert said[1].endswith("about 1 min left")


def test_work_under_way_is_named_before_its_first_item_is_done() -> None:
    said, named = list[str](), Event()

    def say(line: str) -> None:
        said.append(line)
        named.set()

    def soon(items: Iterable[T], label: str, total: int) -> Iterator[T]:
        return report_progress(items, label, total, say=say, first_s=0.01)

    headed = Headed("city", soon)
    assert with_progress(lambda: named.wait(HANGS_S), "learning the words", headed)
    assert said == ["city: learning the words ..."]
