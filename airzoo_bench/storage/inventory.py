"""What is kept on this machine to save time, how much room it takes, and its removal.

Only folders are known here that this suite makes under names of its own, and links are not
followed, so that nothing else can be removed.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.temporaries import temporary_folder
from airzoo_bench.storage.cache import cache_folder
from airzoo_bench.storage.mirror import mirror_of

__all__ = ["Kept", "kept_in", "kept_in_cache", "remove"]

_MIRROR = re.compile(r"[0-9a-f]{24}")
_TASKS = re.compile(r"run-[0-9a-f]{12}\.unfinished")
_UNSENT = re.compile(r"unsent-[0-9a-f]{12}")


@dataclass(frozen=True)
class Kept:
    """A folder that is kept.

    Attributes
    ----------
    path : Path
    kind : str
        What it is, in a word or two.
    what : str
        What it is of.
    size : int
        Bytes.
    used_s : float
        When it was last used or written to, seconds since 1970.
    spare : bool
        Whether it is made or fetched again where it is missed.
    """

    path: Path
    kind: str
    what: str
    size: int
    used_s: float
    spare: bool


def kept_in_cache() -> list[Kept]:
    """List mirrors, finished tasks of runs at URLs, and runs that could not be uploaded."""
    found = []
    for path in _folders(cache_folder()):
        mirror = mirror_of(path / "any") if _MIRROR.fullmatch(path.name) else None
        if mirror is not None:
            found.append(_measured(path, "mirror", str(mirror[0].url), spare=True))
        elif _TASKS.fullmatch(path.name):
            found.append(_measured(path, "finished tasks", str(path), spare=True))
        elif _UNSENT.fullmatch(path.name):
            found.append(_measured(path, "run not uploaded", str(path), spare=False))
    return found


def kept_in(place: Path, kind: str, names: str, *, spare: bool) -> list[Kept]:
    """List the folders in a place.

    Parameters
    ----------
    place : Path
        It need not exist.
    kind : str
    names : str
        A regular expression: folders of other names are somebody else's.
    spare : bool
        See `Kept`.
    """
    listed = () if place.is_symlink() else _folders(place)
    folders = (path for path in listed if re.fullmatch(names, path.name))
    return [_measured(path, kind, str(path), spare=spare) for path in folders]


def remove(kept: Kept) -> None:
    """Remove a folder that is made again where it is missed; nobody finds a part of it.

    Raises
    ------
    ValueError
        It is not made again.
    """
    if not kept.spare:
        raise ValueError(f"{kept.path} is not to be removed")
    with temporary_folder(kept.path.parent, kept.path.name) as aside:
        kept.path.replace(aside / kept.path.name)


def _folders(place: Path) -> Iterator[Path]:
    if place.is_dir():
        with os.scandir(place) as entries:
            yield from sorted(Path(one) for one in entries if one.is_dir(follow_symlinks=False))


def _measured(path: Path, kind: str, what: str, *, spare: bool) -> Kept:
    stated = [path.lstat()]
    for folder, _, names in os.walk(path):
        for name in names:
            with suppress(FileNotFoundError):  # another run is at it
                stated.append(Path(folder, name).lstat())
    size = sum(one.st_size for one in stated[1:])
    return Kept(path, kind, what, size, max(one.st_mtime for one in stated), spare)
