"""Where work is done: options that several commands have, and how it is shown."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from airzoo_bench.cli.built import parameter
from airzoo_bench.cli.common import JobsOption, printable, progress, say
from airzoo_bench.core.progress import Progress, report_progress
from airzoo_bench.engines.engine import EngineKind

if TYPE_CHECKING:
    from airzoo_bench.engines.engine import Engine
    from airzoo_bench.evaluation.scene_store import SceneStore

T = TypeVar("T")

_EVERY_S = 5.0

EngineOption = Annotated[
    EngineKind,
    typer.Option(
        "--engine",
        help="Where work is done: here, or on workers of Dask (extra `dask`); the result is the "
        "same.",
    ),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="local|ADDRESS",
        help="Dask scheduler: local, which starts --jobs worker processes here (default), or the "
        "address of a running one, such as tcp://10.0.0.5:8786, with all files under the same "
        "paths.",
        show_default=False,
    ),
]
ResumeOption = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="Keep each scene that is scored, and go on from those that a run with this --out and "
        "--resume had kept when it was stopped.",
    ),
]
ProgressOption = Annotated[
    bool,
    typer.Option(
        "--progress",
        help="Show blocks, rate, time left and the address of Dask's dashboard.",
    ),
]


def engine_parameters(jobs: int) -> list[Parameter]:
    """Return the options of a command whose work may be done elsewhere."""
    return [
        parameter("jobs", JobsOption, jobs),
        parameter("engine", EngineOption, EngineKind.LOCAL),
        parameter("scheduler", SchedulerOption, None),
        parameter("show_progress", ProgressOption, False),
    ]


@contextmanager
def keep_scenes(beside: Path | None, *, resume: bool) -> Iterator[SceneStore | None]:
    """Open the store of scored scenes for ``--resume``; remove it when the block is done."""
    if beside is None or not resume:
        yield None
        return
    from airzoo_bench.evaluation.scene_store import SceneStore

    store = SceneStore(beside.with_name(f"{beside.name}.unfinished"))
    if store.paths():
        say(f"{store.folder} holds scored scenes, which are used where they are of this very run")
    else:
        say("no scene of an earlier run is kept: all begins anew")
    try:
        yield store
    except KeyboardInterrupt:
        if store.paths():
            say(f"scored scenes are kept in {store.folder}; the same command goes on from there")
        raise
    store.remove()


def choose_progress(place: Engine, *, show_progress: bool) -> Progress:
    """Return how the work of an engine is shown; say where its dashboard is."""
    if show_progress and place.dashboard is not None:
        say(f"dashboard: {place.dashboard}")
    return rated if show_progress else progress


# Stages that are shown at the moment: a track may show one that its engine shows as well.
_shown: set[str] = set()


def rated(items: Iterable[T], label: str, total: int) -> Iterator[T]:
    """Yield the items and show how many are done, how fast, and how long the rest takes."""
    if label in _shown:
        yield from items
        return
    _shown.add(label)
    try:
        if sys.stderr.isatty():
            from airzoo_bench.cli.bars import bar

            yield from bar(items, printable(label), total, rate=True)
        else:
            yield from report_progress(items, label, total, say=say, every_s=_EVERY_S, rate=True)
    finally:
        _shown.remove(label)
