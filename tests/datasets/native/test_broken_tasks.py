"""Scenes as tasks of several workers: what is kept when one fails, is killed or stopped."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.engines.dask import local_cluster
from airzoo_bench.engines.engine import Engine, Processes
from tests.datasets.native.flights import SCENES, everything
from tests.datasets.native.watched_flights import World
from tests.support import HANGS_S

HOME = Path(__file__).resolve().parents[3]


@pytest.fixture
def whole(world: World) -> dict[str, bytes]:
    """Return what one task after the other makes."""
    found = everything(world.make().folder)
    shutil.rmtree(world.home / "data")
    assert world.read() == sorted(SCENES)
    return found


@pytest.fixture(params=["processes", "dask"])
def two(request: pytest.FixtureRequest, data: Path) -> Iterator[Engine]:
    if request.param == "processes":
        yield Processes(2)
    else:
        with local_cluster(2, 1 << 30) as engine:
            yield engine


def test_what_others_finished_is_kept_when_the_first_fails(
    world: World, whole: dict[str, bytes], two: Engine
) -> None:
    world.hold("one", until=("two", "three"))
    (world.source / "one" / "broken").touch()
    with pytest.raises(BenchmarkError, match="half a download") as caught:
        world.make(two)
    assert caught.value.fix is not None
    assert caught.value.fix.startswith("leave the scene out with --keep-going")
    assert world.notes[-1].startswith(f"2 finished scenes of 3 are kept in {world.staging}")
    assert world.read() == sorted(SCENES)
    (world.source / "one" / "broken").unlink()
    made = world.make(two)
    assert world.read() == ["one"]
    assert everything(made.folder) == whole
    assert list(made.summaries) == [*SCENES]
    assert not world.staging.exists()


def test_scenes_that_fail_are_left_out_in_order(world: World, two: Engine) -> None:
    world.hold("one", until=("three",))
    (world.source / "two" / "broken").touch()
    made = world.make(two, keep_going=True)
    assert list(made.summaries) == list(made.facts) == ["one", "three"]
    assert [*made.failed] == ["two"]
    assert "half a download" in made.failed["two"]
    assert ("scenes", 3) in world.shown


@pytest.mark.slow
def test_a_worker_killed_on_the_way_changes_no_byte(world: World, whole: dict[str, bytes]) -> None:
    (world.home / "two-kills").touch()
    with local_cluster(2, 1 << 30) as engine:
        made = world.make(engine)
    assert not (world.home / "two-kills").exists()
    assert world.read().count("two") > 1
    assert everything(made.folder) == whole
    assert [path.name for path in (world.home / "data").iterdir()] == ["flights"]


def test_a_process_that_is_killed_is_told_and_the_next_run_goes_on(
    world: World, whole: dict[str, bytes]
) -> None:
    (world.home / "two-kills").touch()
    with pytest.raises(UserError, match="scenes: a process was killed"):
        world.make(Processes(2))
    assert everything(world.make(Processes(2)).folder) == whole
    assert [path.name for path in (world.home / "data").iterdir()] == ["flights"]


_COMMAND = """
from airzoo_bench.__main__ import main
from airzoo_bench.core.registry import DATASETS
from tests.datasets.native.watched_flights import WatchedFlights

if __name__ == "__main__":
    DATASETS.add("flights", WatchedFlights())
    main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("engine", ["local", pytest.param("dask", marks=pytest.mark.slow)])
def test_ctrl_c_keeps_what_is_finished(world: World, whole: dict[str, bytes], engine: str) -> None:
    world.hold("two", until=("four",))
    script, folder = world.home / "command.py", world.home / "data" / "flights"
    script.write_text(_COMMAND)
    ask = ("prepare", "flights", "--source", world.source, "--out", folder, "--jobs", 2)
    process = subprocess.Popen(
        [sys.executable, str(script), *map(str, ask), "--engine", engine],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {"PYTHONPATH": str(HOME)},
    )
    while not all(world.finished(scene).exists() for scene in ("one", "three")):
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=HANGS_S)
    assert process.returncode == 130, said
    assert "2 finished scenes of 3 are kept" in said
    assert "Traceback" not in said
    (world.home / "two-waits-for").unlink()
    world.read()
    assert everything(world.make().folder) == whole
    assert world.read() == ["two"]
