"""What the tests themselves stand on."""

from __future__ import annotations

import time
from multiprocessing import get_context
from multiprocessing.synchronize import Barrier
from pathlib import Path

import pytest

from tests.shared import made_once


class Factory:
    """The temporary folder of a worker of pytest-xdist."""

    def __init__(self, home: Path) -> None:
        self.home = home

    def getbasetemp(self) -> Path:
        return self.home


def make(folder: Path) -> None:
    time.sleep(0.5)  # in which the other comes
    with (folder.parent / "made").open("a") as stream:
        stream.write("x")
    (folder / "whole").touch()


def ask(home: Path) -> None:
    assert (made_once(Factory(home), "thing", make) / "whole").exists()  # type: ignore[arg-type]


def ask_together(home: Path, together: Barrier) -> None:
    together.wait()
    ask(home)


@pytest.fixture
def workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Return the temporary folders of two workers, one of which this process is."""
    monkeypatch.setenv("PYTEST_XDIST_WORKER", "gw0")
    homes = [tmp_path / name for name in ("popen-gw0", "popen-gw1")]
    for home in homes:
        home.mkdir()
    return homes


def test_two_workers_make_a_folder_once(workers: list[Path], tmp_path: Path) -> None:
    spawn = get_context("spawn")
    together = spawn.Barrier(2)
    processes = [spawn.Process(target=ask_together, args=(home, together)) for home in workers]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0, 0]
    assert (tmp_path / "made").read_text() == "x"


def test_what_could_not_be_made_is_made_anew(workers: list[Path], tmp_path: Path) -> None:
    def fail(folder: Path) -> None:
        (folder / "half").touch()
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        made_once(Factory(workers[0]), "thing", fail)  # type: ignore[arg-type]
    ask(workers[1])
    assert [path.name for path in (tmp_path / "shared-thing").iterdir()] == ["whole"]
