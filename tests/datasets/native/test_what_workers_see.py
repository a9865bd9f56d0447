"""What workers must see, and what they show."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.progress import silent
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.published.options import AirZooRealOptions
from airzoo_bench.datasets.scene_parts import SceneSource
from airzoo_bench.engines.engine import Engine, Processes
from tests.datasets.native.watched_flights import T, World

VARIABLE = "AIRZOO_BENCH_DATA"


class Moving(Engine):
    """Workers that do not see a file which this machine has."""

    def __init__(self, hidden: Path) -> None:
        super().__init__()
        self.hidden = hidden

    def map(self, *args: Any, **named: Any) -> Iterator[Any]:
        self.hidden.rename(self.hidden.with_name("elsewhere"))
        return super().map(*args, **named)


@pytest.mark.parametrize("hidden", ["source/two", "data/.flights.prepare"])
def test_a_worker_that_does_not_see_files_says_so(world: World, hidden: str) -> None:
    with pytest.raises(UserError, match=r"a worker on .* does not see this") as caught:
        world.make(Moving(world.home / hidden))
    assert caught.value.where == str(world.home / hidden)
    assert "on a file system that this machine and all workers see" in str(caught.value)


def test_relative_paths_are_seen_from_where_the_run_was_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("dom.tif", "0", "tree"):  # a file may be called as a number
        (tmp_path / name).touch()
    options = AirZooRealOptions(Path("tree"), dom=["City=dom.tif"], height_offset=["City=0"])
    monkeypatch.chdir(tmp_path)
    source = SceneSource(("City",), lambda given, *_: given, lambda _: [], options)
    assert source.native("City", silent) is options
    monkeypatch.chdir("/")
    assert source.native("City", silent) == replace(
        options, source=tmp_path / "tree", dom=[f"City={tmp_path / 'dom.tif'}"]
    )


def test_other_processes_show_nothing(tmp_path: Path) -> None:
    given = PrepareSettings(tmp_path, tmp_path, copy=True, engine=Processes(2), progress=shown)
    sent = pickle.loads(pickle.dumps(given))  # noqa: S301 - its own
    assert sent == replace(given, engine=sent.engine, progress=silent, note=sent.note)
    assert isinstance(sent.engine, Engine)


def shown(items: Iterable[T], label: str, total: int) -> Iterator[T]:
    raise AssertionError(label)
