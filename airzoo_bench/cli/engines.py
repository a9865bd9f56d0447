"""Where work is done: options that several commands have, and how it is shown."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from airzoo_bench.cli.common import printable, progress, say
from airzoo_bench.core.plurals import counted
from airzoo_bench.core.progress import Progress, told
from airzoo_bench.engines.choose import EngineKind

if TYPE_CHECKING:
    from airzoo_bench.engines.engine import Engine
    from airzoo_bench.engines.kept import Kept
    from airzoo_bench.engines.watched import Watched

__all__ = [
    "EngineOption",
    "ProgressOption",
    "ResumeOption",
    "SchedulerOption",
    "choose_progress",
    "rated",
    "watched",
]

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
        help="Of Dask: local, which starts --jobs worker processes here (default), or one that "
        "stands, such as tcp://10.0.0.5:8786. Its workers must see all files under the paths that "
        "they have here.",
        show_default=False,
    ),
]
ResumeOption = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="Go on from the tasks that a run with this --out had finished when it was stopped. "
        "With --engine dask they are always kept; here, where --resume was given to that run too.",
    ),
]
ProgressOption = Annotated[
    bool,
    typer.Option(
        "--progress", help="Show tasks, rate, time left and the address of Dask's dashboard."
    ),
]


@contextmanager
def watched(
    place: Engine, *, show_progress: bool, keep_for: Path | None = None, resume: bool = False
) -> Iterator[Watched]:
    """Show the work of an engine; keep what is finished until the block is done.

    Parameters
    ----------
    place : Engine
    show_progress : bool
        What ``--progress`` shows.
    keep_for : Path, optional
        The folder of the run, beside which finished tasks are kept.
    resume : bool
        Use what is kept there.
    """
    from airzoo_bench.engines.watched import Watched

    kept = None if keep_for is None else _kept(keep_for, place, resume=resume)
    used = place if kept is None or not (resume or place.distributed) else kept
    watching = Watched(used, rated if show_progress else progress)
    if show_progress:
        _say_dashboard(place)
    try:
        yield watching
    except KeyboardInterrupt:
        if used is kept and kept.leftovers:
            _say_how_to_go_on(kept)
        raise
    if kept is not None:
        kept.remove()


def choose_progress(place: Engine, *, show_progress: bool) -> Progress:
    """Return how the work of an engine is shown by who gives it tasks; say where its pages are.

    Parameters
    ----------
    place : Engine
    show_progress : bool
        What ``--progress`` shows.
    """
    if show_progress:
        _say_dashboard(place)
    return rated if show_progress else progress


def _say_dashboard(place: Engine) -> None:
    if place.dashboard is not None:
        say(f"dashboard: {place.dashboard}")


def _say_how_to_go_on(kept: Kept) -> None:
    tasks = counted(kept.leftovers, "finished task")
    say(f"{tasks} kept in {kept.folder}; the same command with --resume goes on from there")


def _kept(out: Path, place: Engine, *, resume: bool) -> Kept:
    """Return the engine that keeps finished tasks beside the run's folder; say what lies there."""
    from airzoo_bench.engines.kept import Kept, kept_folder

    kept = Kept(place, kept_folder(out), reuse=resume)
    found = f"{kept.folder} holds {counted(kept.leftovers, 'finished task')}"
    if resume and not kept.leftovers:
        say("no task of an earlier run is kept: all begins anew")
    elif resume:
        say(f"{found}, which are used where they are of this very run")
    elif kept.leftovers:
        say(
            f"{found} of a run that was stopped; with --resume this run would go on from them, "
            "without it they are removed when it is saved"
        )
    return kept


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
            yield from told(items, label, total, say=say, every_s=_EVERY_S, rate=True)
    finally:
        _shown.remove(label)
