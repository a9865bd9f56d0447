"""Find a benchmark's files below the user's folder, or name what is there instead."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path, PurePosixPath
from typing import TypeVar

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols

T = TypeVar("T")

_ENDING = re.compile("|".join(rf"\{suffix}$" for suffix in PHOTO_SUFFIXES), re.IGNORECASE)


def missing(what: str, folder: Path, layout: str, fix: str | None = None) -> BenchmarkError:
    """Make the error of a part that is not there, or there twice; it says what is there."""
    if not folder.is_dir():
        return BenchmarkError("no such folder", where=folder, expected=layout, fix=fix)
    names = sorted(path.name + "/" * path.is_dir() for path in folder.iterdir())
    there = f"there are {first_of(names, shown=6)}" if names else "it is empty"
    fix = fix or "download it again, unpack it whole, and name its folder as --source"
    return BenchmarkError(f"{what}: {there}", where=folder, expected=layout, fix=fix)


def folders_in(folder: Path) -> list[Path]:
    """Return the folders in a folder by name; none where it is none."""
    found = folder.iterdir() if folder.is_dir() else ()
    return sorted(path for path in found if path.is_dir())


def sub_path(folder: Path, *parts: str) -> Path | None:
    """Return the entry of a folder with one of these names in any case, or None."""
    for part in parts:
        inside = folder.iterdir() if folder.is_dir() else ()
        found = [path for path in inside if path.name.casefold() == part.casefold()]
        exact = [path for path in found if path.name == part] or found
        if len(exact) != 1:
            return None
        folder = exact[0]
    return folder


def needed_path(folder: Path, place: str, layout: str) -> Path:
    """Return the path below a folder whose parts match in any case."""
    found = sub_path(folder, *place.split("/"))
    if found is None:
        raise missing(f"lacks {place}", folder, layout)
    return found


def find_home(source: Path, is_home: Callable[[Path], bool], layout: str) -> Path:
    """Return the folder that is a benchmark: the one named, or the only one in it."""
    if source.is_dir() and is_home(source):
        return source
    found = [folder for folder in folders_in(source) if is_home(folder)]
    if len(found) != 1:
        raise missing(f"holds {len(found)} folders that could be the benchmark", source, layout)
    return found[0]


def stem_key(name: str) -> str:
    """Return a file's name up to its first point, without the folders before it."""
    return PurePosixPath(name.replace("\\", "/")).name.split(".", 1)[0]


def stem_of(name: str) -> str:
    """Return a photo's name without its ending, with points for underscores."""
    return _ENDING.sub("", name.strip()).replace("_", ".")


def files_by_key(
    folder: Path, key: Callable[[str], str], layout: str, names: Iterable[str] | None = None
) -> dict[str, str]:
    """Return the photos of a folder, or those named, by the key of their names, in that order."""
    there = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    photos = [n for n in there if n.lower().endswith(PHOTO_SUFFIXES) and not n.startswith(".")]
    photos = list(photos if names is None else names)
    twice = [one for one, count in Counter(map(key, photos)).items() if count > 1]
    if twice or not photos:
        raise missing(f"holds no photo, or several each of {first_of(twice)}", folder, layout)
    return dict(sorted((key(name), name) for name in photos))


def published_scenes(protocol: str) -> list[str]:
    """Return the ids of all scenes of a shipped protocol, in its order."""
    return [scene.id for scene in load_protocol(shipped_protocols()[protocol]).scenes]


def chosen_photos(photos: Sequence[T], every: int) -> tuple[list[T], tuple[str, ...]]:
    """Choose every Nth photo, starting with the first, and say so."""
    chosen = list(photos[::every])
    said = f"one photo in {every} is taken, {len(chosen)} of {len(photos):,} (--every)"
    return chosen, (said,) if every > 1 else ()
