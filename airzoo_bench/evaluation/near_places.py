"""Paths that cannot be predictions, and which folder was meant instead."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from airzoo_bench.core.errors import UnreadableError
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.evaluation.reader import find_reader, reader_named

__all__ = ["place_meant", "refuse_part", "refuse_special"]

_LOOKED_AT = 64
_DEEPEST = 2


def place_meant(path: Path, track: str) -> str | None:
    """Say which folder below or above a folder a reader of a track takes for its own."""
    for place in (*islice(_below(path), _LOOKED_AT), path.resolve().parent):
        title = _title(place, track)
        if title is not None:
            return f"{place} holds {title}: name that"
    return None


def refuse_part(path: Path, track: str) -> None:
    """Refuse a file that only the folder it lies in makes a prediction."""
    if path.suffix in TRACKS.get(track).suffixes or path.resolve().parent == Path.cwd():
        return
    whole = find_reader(path.parent, track)
    if whole is not None:
        raise UnreadableError(
            f"is a part of {reader_named(whole).title}",
            where=path,
            expected=reader_named(whole).layout,
            fix=f"name the folder: {path.parent}",
        )


def refuse_special(path: Path) -> None:
    """Refuse what would be waited for or read without end, before anything is opened."""
    if path.is_symlink() and not path.exists():
        what, fix = "a link to nothing", "copy there what it should lead to"
    elif path.exists() and not (path.is_file() or path.is_dir()):
        what, fix = "a pipe, a socket or a device, and no file", "copy what it gives into a file"
    else:
        return
    raise UnreadableError(what, where=path, expected="a file, or a folder", fix=fix)


def _below(path: Path) -> Iterator[Path]:
    """Yield the folders below one, those of one level after the other."""
    level = [path]
    for _ in range(_DEEPEST):
        level = [one for folder in level for one in islice(_folders(folder), _LOOKED_AT)]
        yield from level


def _folders(path: Path) -> list[Path]:
    try:
        found = [one for one in path.iterdir() if not one.name.startswith(".")]
        return sorted(one for one in found if one.is_dir() and not one.is_symlink())
    except OSError:  # one that may not be listed
        return []


def _title(place: Path, track: str) -> str | None:
    try:
        name = find_reader(place, track)
    except UnreadableError:  # two readers are equally sure
        return None
    reader = None if name is None else reader_named(name)
    return reader.title if reader is not None and reader.track == track else None
