"""What every engine does alike: order, bytes, faults, deaths and Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path

import numpy as np
import psutil
import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.engines.engine import UNREAD, Engine, Processes
from tests.engines import work
from tests.engines.work import named
from tests.support import HANGS_S

HOME = Path(__file__).resolve().parents[2]
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


@pytest.fixture(params=["here", "processes", pytest.param("dask", marks=pytest.mark.slow)])
def engine(request: pytest.FixtureRequest) -> Engine:
    if request.param == "dask":
        found: Engine = request.getfixturevalue("dask")
        return found
    return Engine() if request.param == "here" else Processes(2)


def test_results_come_in_the_order_of_the_items(engine: Engine) -> None:
    found = engine.map(work.square, range(300), shared=7, stage="squares", name=named)
    assert [int(one["square"][0]) for one in found] == [n * n + 7 for n in range(300)]
    assert list(engine.map(work.square, [], shared=0, stage="squares", name=named)) == []


def test_sums_are_the_same_bytes(engine: Engine) -> None:
    random = np.random.default_rng(0)
    shared = b"odd", random.random(100_001)
    items = [random.random(100_001) for _ in range(6)]
    expected = [work.total(shared, item) for item in items]
    assert list(engine.map(work.total, items, shared=shared, stage="sums", name=str)) == expected


def test_work_is_done_by_two_others(engine: Engine, tmp_path: Path) -> None:
    if not engine.distributed:
        pytest.skip("all is done here")
    found = engine.map(work.meet, range(8), shared=tmp_path, stage="s", name=named)
    assert len({*found} - {os.getpid()}) == 2


def test_few_blocks_wait_to_be_read(tmp_path: Path) -> None:
    found = Processes(2).map(work.marking, range(100), shared=tmp_path, stage="s", name=named)
    next(found)
    time.sleep(1.0)
    assert len(list(tmp_path.iterdir())) <= 2 * UNREAD
    assert list(found) == list(range(1, 100))


def test_blocks_do_not_depend_on_the_number_of_workers() -> None:
    assert Processes(2).cut(10, 4) == Processes(8).cut(10, 4)
    assert Processes(2).cut(10, 4) == [slice(0, 4), slice(4, 8), slice(8, 10)]
    assert Engine().cut(10, 4) == [slice(0, 10)]
    assert Engine().cut(0, 4) == []


@pytest.mark.parametrize(
    ("how", "what", "where", "fix"),
    [
        ("unreadable", "shard-3.npy", "shard 3", "mend"),
        ("hungry", "memory", "shard 3", "lower --jobs"),
        ("long", "x" * 20_000, "row 3", "cut it"),  # it has a place of its own
    ],
)
def test_a_fault_comes_whole_and_names_its_block(
    engine: Engine, how: str, what: str, where: str, fix: str
) -> None:
    with pytest.raises(UserError) as caught:
        list(engine.map(work.faulty, range(6), shared=Path(how), stage="shards", name=named))
    assert what in caught.value.what
    assert caught.value.where == where
    assert fix in str(caught.value.fix)


def test_a_bug_keeps_its_class_and_its_traceback(engine: Engine) -> None:
    with pytest.raises(KeyError) as caught:
        list(engine.map(work.faulty, range(9), shared=Path("buggy"), stage="s", name=named))
    assert "in faulty" in "".join(traceback.format_exception(caught.value))


def test_a_run_that_is_left_early_leaves_the_engine_usable(engine: Engine) -> None:
    for made, shared in ((work.square, 0), (work.large, 3_000_000)):  # which fills pipes
        found = engine.map(made, range(50), shared=shared, stage="s", name=named)
        next(found)
        found.close()  # type: ignore[attr-defined]
    assert len(list(engine.map(work.square, range(9), shared=0, stage="s", name=named))) == 9


@posix
@pytest.mark.slow
def test_a_worker_of_dask_killed_once_changes_nothing_and_always_is_an_error(
    dask: Engine, tmp_path: Path
) -> None:
    found = dask.map(work.dying_once, range(20), shared=tmp_path, stage="shards", name=named)
    assert list(found) == list(range(20))
    assert (tmp_path / "died").exists()
    check_deadly(dask)


@posix
def test_a_process_that_was_killed_is_one_message() -> None:
    check_deadly(Processes(2))


def check_deadly(engine: Engine) -> None:
    begin = time.monotonic()
    with pytest.raises(UserError, match=r"^shards: .*killed|^shards: 3 workers died") as caught:
        list(engine.map(work.deadly, range(30), shared=11, stage="shards", name=named))
    assert time.monotonic() - begin < HANGS_S
    assert "lower --jobs" in str(caught.value.fix)
    assert len(list(engine.map(work.deadly, range(9), shared=-1, stage="s", name=named))) == 9


HOLDING = """
import sys
from pathlib import Path
from airzoo_bench.engines.engine import Processes, open_engine
from tests.engines import work

if __name__ == "__main__":
    where, folder = sys.argv[1], Path(sys.argv[2])
    with open_engine(where, jobs=2, here=Processes(2)) as engine:
        for _ in engine.map(work.waiting, range(40), shared=folder, stage="s", name=str):
            pass
"""


@posix
@pytest.mark.parametrize("kind", ["local", pytest.param("dask", marks=pytest.mark.slow)])
@pytest.mark.parametrize("by", ["SIGINT", pytest.param("SIGKILL", marks=pytest.mark.slow)])
def test_no_worker_outlives_its_run(tmp_path: Path, kind: str, by: str) -> None:
    script = tmp_path / "script.py"
    script.write_text(HOLDING)
    process = subprocess.Popen(
        [sys.executable, str(script), kind, str(tmp_path)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {"PYTHONPATH": str(HOME)},
    )
    while len({path.name for path in tmp_path.glob("at-*")} - {"at-0", "at-1"}) < 2:
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    workers = psutil.Process(process.pid).children(recursive=True)
    assert len(workers) >= 2
    if by == "SIGINT":
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does it, to all of them
    else:
        process.kill()
    _, errors = process.communicate(timeout=HANGS_S)
    assert process.returncode != 0
    assert psutil.wait_procs(workers, timeout=HANGS_S)[1] == []
    if by == "SIGINT":
        assert errors.splitlines()[-1] == "KeyboardInterrupt"
        assert errors.count("Traceback") == 1
