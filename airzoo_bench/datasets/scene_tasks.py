"""Scenes as tasks: each is made by itself, wherever the engine does its work."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.files import DATA_VARIABLE, PART, cannot_write, data_root
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.scene_parts import SceneSource, needed_files

__all__ = ["faults_of_writing", "made_scenes", "unseen"]

R = TypeVar("R")

_OF_WRITING = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)
_WAY_OUT = "leave the scene out with --keep-going, or name those to make with --scene"

_Scene = tuple[str, tuple[Path, ...]]


@dataclass(frozen=True)
class _Run(Generic[R]):
    """What the tasks of a run share."""

    make: Callable[[str], R]
    folder: Path
    root: Path
    keep_going: bool
    several: bool


def made_scenes(
    make: Callable[[str], R],
    source: SceneSource,
    scenes: Sequence[str],
    settings: PrepareSettings,
    *,
    needed: Sequence[Path] = (),
) -> Iterator[tuple[str, R | UserError]]:
    """Make scenes, each a task; yield them in their order."""
    root, several = data_root().absolute(), len(source.scenes) > 1
    run = _Run(make, settings.folder, root, source.keep_going, several)
    items = [(scene, _there([*needed, *needed_files(source, scene)])) for scene in scenes]
    found = settings.engine.map(_task, items, shared=run, stage="scenes", name=_name)
    label = f"scene {scenes[0]}" if len(scenes) == 1 else "scenes"
    found = settings.progress(found, label, len(items))
    yield from zip(scenes, found, strict=True)


def _there(paths: Sequence[Path]) -> tuple[Path, ...]:
    return tuple(path for path in paths if path.exists())


@contextmanager
def faults_of_writing(folder: Path) -> Iterator[None]:
    """Make one message of all that a disk says which takes no more."""
    try:
        yield
    except OSError as error:
        if error.errno not in _OF_WRITING:  # it is a file that is read
            raise
        named = Path(os.fsdecode(error.filename)) if error.filename else folder
        raise cannot_write(folder if named.name.endswith(PART) else named, error) from None


def unseen(what: str, where: object) -> UserError:
    """Return the message of a file that one machine has and another does not."""
    return UserError(
        what,
        where=where,
        expected="source, data root and the folder to make on a file system that this machine and "
        "all workers see, under the same paths",
        fix="put them there, or leave out --scheduler",
    )


def _name(scene: _Scene) -> str:
    return f"scene {scene[0]}"


def _task(run: _Run[R], scene: _Scene) -> R | UserError:
    name, needed = scene
    _check_seen(needed, run.root)
    with faults_of_writing(run.folder):
        try:
            return run.make(name)
        except UserError as fault:
            if run.keep_going:
                return fault
            if run.several:
                fault.fix = f"{fault.fix}; or {_WAY_OUT}" if fault.fix else _WAY_OUT
            raise


def _check_seen(needed: Sequence[Path], root: Path) -> None:
    """Refuse to work where the files of the run are not those of the machine that calls."""
    here = f"a worker on {socket.gethostname()}"
    if data_root().absolute() != root:
        raise UserError(
            f"{here} has another data root than this run: {data_root().absolute()}",
            where=DATA_VARIABLE,
            expected=f"{root}, on a file system that all workers see",
            fix=f"set {DATA_VARIABLE}={root} where workers are started",
        )
    hidden = next((path for path in needed if not path.exists()), None)
    if hidden is not None:
        raise unseen(f"{here} does not see this", hidden)
