from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.core.version import versions
from airzoo_bench.engines import dask_tasks
from airzoo_bench.engines.cluster import local_cluster
from airzoo_bench.engines.dask_tasks import DaskEngine
from airzoo_bench.engines.engine import Engine
from tests.engines import work
from tests.engines.work import named
from tests.support import HANGS_S

GIB = 1 << 30
HOME = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def engine() -> Iterator[DaskEngine]:
    with local_cluster(2, GIB) as made:
        yield made


def test_results_come_in_the_order_of_the_items(engine: Engine) -> None:
    found = engine.map(work.square, range(1_000), shared=7, stage="squares", name=named)
    assert [int(one["square"][0]) for one in found] == [n * n + 7 for n in range(1_000)]


def test_work_is_done_by_the_workers(engine: Engine) -> None:
    found = engine.map(work.square, range(200), shared=0, stage="squares", name=named)
    workers = {int(one["who"]) for one in found}
    assert len(workers) == 2
    assert os.getpid() not in workers


def test_this_process_keeps_its_threads() -> None:
    """Dask gives libraries of its workers one thread each, and would give it to this one's too."""
    before = dict(os.environ)
    with local_cluster(1, GIB):
        assert dict(os.environ) == before


def test_nothing_to_do_gives_nothing(engine: Engine) -> None:
    assert list(engine.map(work.square, [], shared=0, stage="squares", name=named)) == []


def test_a_worker_of_other_versions_does_nothing(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may have joined after the run began; results would state the client's versions."""
    other = versions() | {"pycolmap": "0.1"}
    monkeypatch.setattr(dask_tasks, "versions", lambda: other)
    with pytest.raises(UserError, match=r"a worker has pycolmap [\d.]+ and not 0\.1"):
        list(engine.map(work.square, range(9), shared=0, stage="squares", name=named))


def test_what_is_cut_depends_on_the_size_alone(engine: Engine) -> None:
    assert engine.cut(10, 4) == [slice(0, 4), slice(4, 8), slice(8, 10)]
    assert engine.cut(0, 4) == []


def test_a_worker_killed_in_the_middle_changes_nothing(engine: Engine, tmp_path: Path) -> None:
    found = engine.map(work.dying_once, range(20), shared=tmp_path, stage="shards", name=named)
    assert list(found) == list(range(20))
    assert (tmp_path / "died").exists()


def test_a_task_that_kills_its_workers_is_named_and_no_other(engine: Engine) -> None:
    done: list[int] = []
    with pytest.raises(UserError) as caught:
        done.extend(engine.map(work.deadly, range(30), shared=11, stage="shards", name=named))
    assert caught.value.where == "shard 11"
    assert "workers died of it" in caught.value.what
    assert caught.value.fix == engine.more_memory
    assert done == list(range(11))


def test_the_cluster_works_after_deaths(engine: Engine) -> None:
    found = engine.map(work.deadly, range(30), shared=-1, stage="shards", name=named)
    assert list(found) == list(range(30))


def test_an_unreadable_shard_is_named(engine: Engine, tmp_path: Path) -> None:
    with pytest.raises(UserError) as caught:
        list(engine.map(work.unreadable, range(6), shared=tmp_path, stage="shards", name=named))
    assert caught.value.where == "shard 3"
    assert "shard-3.npy" in caught.value.what


def test_a_bug_keeps_its_class_and_its_traceback(engine: Engine) -> None:
    with pytest.raises(KeyError) as caught:
        list(engine.map(work.buggy, range(9), shared={0: 1}, stage="shards", name=named))
    names = [frame.name for frame in traceback.extract_tb(caught.tb)]
    assert "buggy" in names


def test_the_first_fault_in_the_order_of_the_items_is_told_whole(engine: Engine) -> None:
    with pytest.raises(PredictionError) as caught:
        list(engine.map(work.faulty, range(9), shared=20_000, stage="rows", name=named))
    fault = caught.value
    assert fault.what == "x" * 20_000
    assert (fault.where, fault.expected, fault.fix) == ("row 3", "less", "cut it")


def test_a_task_without_memory_is_named(engine: Engine) -> None:
    with pytest.raises(UserError, match="shard 3: too little memory") as caught:
        list(engine.map(work.hungry, range(6), shared=None, stage="shards", name=named))
    assert caught.value.fix == engine.more_memory


def test_a_run_that_is_left_early_leaves_the_cluster_usable(engine: Engine) -> None:
    found = engine.map(work.square, range(500), shared=0, stage="squares", name=named)
    next(found)
    found.close()  # type: ignore[attr-defined]
    again = engine.map(work.square, range(5), shared=1, stage="squares", name=named)
    assert [int(one["square"][0]) for one in again] == [1, 2, 5, 10, 17]


HOLDING = """
import sys
from pathlib import Path
from airzoo_bench.engines.choose import EngineKind, chosen_engine
from airzoo_bench.engines.watched import Watched
from tests.engines import work

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    with chosen_engine(EngineKind.DASK, "local", jobs=2, memory_bytes=1 << 30) as engine:
        for _ in engine.map(work.waiting, range(40), shared=folder, stage="s", name=str):
            pass
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("by", ["SIGINT", pytest.param("SIGKILL", marks=pytest.mark.slow)])
def test_no_worker_outlives_its_run(tmp_path: Path, by: str) -> None:
    script = tmp_path / "script.py"
    script.write_text(HOLDING)
    process = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)],
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
        assert "distributed" not in errors.split("Traceback")[0]
