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

__all__ = [
    "chosen_photos",
    "files_by_key",
    "find_home",
    "missing",
    "needed_path",
    "published_scenes",
    "stem_key",
    "stem_of",
    "sub_path",
]

T = TypeVar("T")

# Archives and unfinished downloads.
_PACKED = (".zip", ".7z", ".rar", ".tar", ".tgz", ".gz", ".part", ".crdownload", ".aria2")
_ENDING = re.compile("|".join(rf"\{suffix}$" for suffix in PHOTO_SUFFIXES), re.IGNORECASE)


def missing(what: str, folder: Path, layout: str, fix: str | None = None) -> BenchmarkError:
    """Make the error of a part that is not there, or there twice; it says what is there."""
    if not folder.is_dir():
        return BenchmarkError("no such folder", where=folder, expected=layout, fix=fix)
    names = sorted(path.name + "/" * path.is_dir() for path in folder.iterdir())
    packed = [name for name in names if name.lower().endswith(_PACKED)]
    there = f"there are {first_of(packed or names, shown=6)}" if names else "it is empty"
    return BenchmarkError(
        f"{what}: {there}",
        where=folder,
        expected=layout,
        fix=fix or "download it again, unpack it whole, and name its folder as --source",
    )


def sub_path(folder: Path, *parts: str) -> Path | None:
    """Return the entry of a folder with one of these names in any case, or None."""
    for part in parts:
        exact = folder / part
        if exact.exists():
            folder = exact
            continue
        inside = folder.iterdir() if folder.is_dir() else ()
        found = [path for path in inside if path.name.casefold() == part.casefold()]
        if len(found) != 1:
            return None
        folder = found[0]
    return folder


def needed_path(folder: Path, place: str, layout: str, fix: str | None = None) -> Path:
    """Return the path below a folder whose parts match in any case."""
    found = sub_path(folder, *place.split("/"))
    if found is None:
        raise missing(f"lacks {place}", folder, layout, fix)
    return found


def find_home(source: Path, is_home: Callable[[Path], bool], layout: str) -> Path:
    """Return the folder that is a benchmark: the one named, or the only one in it."""
    inside = sorted(path for path in source.iterdir() if path.is_dir()) if source.is_dir() else []
    if source.is_dir() and is_home(source):
        return source
    found = [folder for folder in inside if is_home(folder)]
    if len(found) == 1:
        return found[0]
    names = first_of(folder.name for folder in found)
    what = f"several folders could be the benchmark ({names})" if found else "holds no benchmark"
    raise missing(what, source, layout)


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
    if twice:
        raise missing(
            f"several files each are {first_of(twice)}", folder, layout, "keep one of each"
        )
    if not photos:
        raise missing("holds no photo", folder, layout)
    return dict(sorted((key(name), name) for name in photos))


def published_scenes(protocol: str) -> list[str]:
    """Return the ids of all scenes of a shipped protocol, in its order."""
    return [scene.id for scene in load_protocol(shipped_protocols()[protocol]).scenes]


def chosen_photos(photos: Sequence[T], every: int) -> tuple[list[T], tuple[str, ...]]:
    """Choose every Nth photo, starting with the first, and say so."""
    chosen = list(photos[::every])
    said = f"one photo in {every} is taken, {len(chosen)} of {len(photos):,} (--every)"
    return chosen, (said,) if every > 1 else ()
