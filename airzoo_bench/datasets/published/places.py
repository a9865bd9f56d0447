"""Where a benchmark's folders stand below what the user names, and what stands there instead."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath

from airzoo_bench.core.errors import BenchmarkError, first_of

__all__ = [
    "files_by_key",
    "find_home",
    "folder_content",
    "name_order",
    "stem_key",
    "sub_folder",
]

_PARTIAL = (".part", ".partial", ".crdownload", ".aria2", ".incomplete", ".tmp", ".download")
_ARCHIVES = (".zip", ".7z", ".rar", ".tar", ".tgz", ".gz")


def folder_content(folder: Path) -> str:
    """Say what stands in a folder, unfinished downloads and archives first, for messages."""
    if not folder.is_dir():
        return "there is no such folder"
    names = sorted(path.name + "/" * path.is_dir() for path in folder.iterdir())
    names = [name for name in names if not name.startswith(".")]
    for what, endings in (("an unfinished download", _PARTIAL), ("an archive", _ARCHIVES)):
        found = [name for name in names if name.lower().endswith(endings)]
        if found:
            return f"there is {what}, {found[0]}" + (
                ": unpack it" if what == "an archive" else ": download it again"
            )
    return f"there are {first_of(names, shown=6)}" if names else "it is empty"


def sub_folder(folder: Path, name: str) -> Path | None:
    """Return a folder's part of that name, in letters of either case; None where it lacks it."""
    if (folder / name).exists():
        return folder / name
    if not folder.is_dir():
        return None
    found = [path for path in folder.iterdir() if path.name.casefold() == name.casefold()]
    return found[0] if len(found) == 1 else None


def find_home(source: Path, parts: Sequence[str], layout: str) -> Path:
    """Return the folder that holds a benchmark's parts: the one named, or the only one in it."""
    inside = sorted(path for path in source.iterdir() if path.is_dir()) if source.is_dir() else []
    if _holds(source, parts):
        return source
    found = [folder for folder in inside if _holds(folder, parts)]
    if len(found) == 1:
        return found[0]
    what = (
        f"several folders could be the benchmark: {first_of(f.name for f in found)}"
        if found
        else f"holds none of {', '.join(parts)}: {folder_content(source)}"
    )
    raise BenchmarkError(
        what,
        where=source,
        expected=layout,
        fix="name one of them" if found else "name the folder as it was downloaded and unpacked",
    )


def _holds(folder: Path, parts: Iterable[str]) -> bool:
    return any(sub_folder(folder, part) is not None for part in parts)


def name_order(path: Path) -> list[tuple[str, int]]:
    """Return what sorts names with the numbers in them as numbers: 2 before 10."""
    return [(text, int(n or 0)) for text, n in re.findall(r"([^0-9]*)([0-9]*)", path.name)]


def stem_key(name: str) -> str:
    """Return a file's name up to its first point, without the folders before it."""
    return PurePosixPath(name.replace("\\", "/")).name.split(".", 1)[0]


def files_by_key(folder: Path, suffixes: Sequence[str]) -> dict[str, str]:
    """Return the files of a folder by `stem_key`."""
    there = sorted(folder.iterdir()) if folder.is_dir() else []
    names = [p.name for p in there if p.suffix.lower() in suffixes and not p.name.startswith(".")]
    twice = [key for key, count in Counter(map(stem_key, names)).items() if count > 1]
    if not names or twice:
        raise BenchmarkError(
            f"two files each for {first_of(twice)}"
            if twice
            else f"holds no photo: {folder_content(folder)}",
            where=folder,
            expected=f"a file an image, ending in {', '.join(suffixes)}",
            fix="keep one of each" if twice else "download the folder again",
        )
    return {stem_key(name): name for name in names}
