"""The engines of one machine do the same as Dask's."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.engines.engine import Engine, Here
from airzoo_bench.engines.processes import Processes
from tests.engines import work
from tests.engines.work import named


@pytest.fixture(params=["here", "processes"])
def engine(request: pytest.FixtureRequest) -> Engine:
    return Here() if request.param == "here" else Processes(2)


def test_results_come_in_order(engine: Engine) -> None:
    found = engine.map(work.square, range(40), shared=7, stage="squares", name=named)
    assert [int(one["square"][0]) for one in found] == [n * n + 7 for n in range(40)]


def test_nothing_to_do_gives_nothing(engine: Engine) -> None:
    assert list(engine.map(work.square, [], shared=0, stage="squares", name=named)) == []


def test_an_unreadable_shard_is_named(engine: Engine, tmp_path: Path) -> None:
    with pytest.raises(UserError) as caught:
        list(engine.map(work.unreadable, range(6), shared=tmp_path, stage="shards", name=named))
    assert caught.value.where == "shard 3"


def test_a_fault_of_the_user_keeps_its_fields(engine: Engine) -> None:
    with pytest.raises(PredictionError) as caught:
        list(engine.map(work.faulty, range(9), shared=20_000, stage="rows", name=named))
    fault = caught.value
    assert fault.what == "x" * 20_000
    assert (fault.where, fault.expected, fault.fix) == ("row 3", "less", "cut it")


def test_a_bug_stays_a_bug(engine: Engine) -> None:
    with pytest.raises(KeyError):
        list(engine.map(work.buggy, range(9), shared={0: 1}, stage="shards", name=named))


def test_a_task_without_memory_is_named(engine: Engine) -> None:
    with pytest.raises(UserError, match="shard 3: too little memory") as caught:
        list(engine.map(work.hungry, range(6), shared=None, stage="shards", name=named))
    assert caught.value.fix == "lower --jobs, or run it on a machine with more memory"


def test_a_process_that_was_killed_is_told() -> None:
    with pytest.raises(UserError, match="numbers: a process was killed") as caught:
        list(Processes(2).map(work.deadly, range(9), shared=3, stage="numbers", name=named))
    assert "lower --jobs" in str(caught.value.fix)
