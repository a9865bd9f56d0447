"""Where benchmark folders lie, and where output may stand, asked before work is done for it.

Every command asks: nothing heavy is imported here.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

from airzoo_bench.core.errors import UsageError, UserError

__all__ = [
    "DATA_VARIABLE",
    "MARK",
    "cannot_write",
    "check_new_folder",
    "check_output_file",
    "check_output_folder",
    "data_location",
    "data_root",
    "followed",
]

MARK = "benchmark.toml"
"""What every benchmark folder holds."""


def check_output_folder(folder: Path, names: Iterable[str]) -> None:
    """Refuse a folder for output that cannot take files of these names, before any is written."""
    _refuse_url(folder)
    for place in (folder, *folder.parents):
        if place.exists():
            if not place.is_dir():
                raise UsageError("a file, not a folder", where=place, fix="name a folder")
            break
    for name in names:
        _check_place(folder / name, "name another --out")


def check_output_file(path: Path, inputs: Iterable[Path] = ()) -> None:
    """Refuse a file that cannot be written, before the work that it is to hold."""
    _refuse_url(path)
    try:
        _check_place(path, "name another file")
        _check_folder(followed(path))
    except OSError as error:
        raise cannot_write(path, error) from error
    for one in inputs:
        if one.exists() and path.exists() and path.samefile(one):
            raise UsageError(
                "is read to make what would be written here, and would be lost",
                where=path,
                fix="name another file to write",
            )


def _refuse_url(path: Path) -> None:
    """Refuse what was written as a URL where only `eval` can write to one."""
    if re.fullmatch(r"[a-z][a-z0-9+.-]+:", path.parts[0] if path.parts else "", re.IGNORECASE):
        raise UsageError(
            "looks like a URL, and this is written to a disk",
            where=path,
            expected="a path; of what is written, only runs (`eval --out`) may be at a URL",
            fix="upload it afterwards, with your storage's own tools",
        )


def followed(path: Path) -> Path:
    """Return what a symbolic link leads to; anything else as it is."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def cannot_write(path: Path, error: OSError) -> UserError:
    """Make the error of a file or folder that the system refuses to write."""
    return UserError(
        f"cannot be written: {error.strerror or error}",
        where=path,
        fix="choose a folder you may write to, on a disk with room",
    )


def _check_place(path: Path, fix: str) -> None:
    """Refuse what stands where a file shall be written, if a file cannot take its place."""
    if path.is_symlink() and followed(path).is_symlink():
        raise UsageError("a symbolic link that leads to itself", where=path, fix=fix)
    if not path.exists():
        return
    if path.is_dir():
        raise UsageError("a folder, not a file", where=path, fix=fix)
    if not path.is_file():
        raise UsageError("a pipe or a device, not a file", where=path, fix=fix)
    # Even root would not want to replace what is marked as read-only.
    if not path.stat().st_mode & 0o222 or not os.access(path, os.W_OK):
        raise UsageError("a read-only file, which is not replaced", where=path, fix=fix)


def _check_folder(path: Path) -> None:
    """Refuse a file in a folder that is a file, or that nothing may be written into."""
    place = next(place for place in path.absolute().parents if place.exists())
    if not place.is_dir():
        raise UsageError("a file, not a folder", where=place, fix=f"{path.name} needs a folder")
    if not os.access(place, os.W_OK | os.X_OK):
        raise UsageError(
            "nothing may be written into this folder", where=place, fix="name another one"
        )


DATA_VARIABLE = "AIRZOO_BENCH_DATA"
"""The variable of the environment that names the folder."""


def data_location() -> str | Path:
    """Return where benchmark folders lie: AIRZOO_BENCH_DATA, path or URL, else a cache folder."""
    named = os.environ.get(DATA_VARIABLE)
    if named:
        return named if "://" in named else Path(named).expanduser()
    from platformdirs import user_cache_path

    return user_cache_path("airzoo-bench") / "data"


def data_root() -> Path:
    """Return the folder of this machine in which benchmark folders lie and are made."""
    place = data_location()
    if isinstance(place, str):
        raise UsageError(
            "a URL, and a folder of this machine is needed",
            where=f"{DATA_VARIABLE}={place}",
            fix=f"set {DATA_VARIABLE} to a folder; what is read may be a URL, by --data",
        )
    return place


def check_new_folder(path: Path, *, replace: bool, mark: str = MARK) -> None:
    """Refuse a folder that cannot be made, or must not be replaced."""
    if not path.exists():
        check_output_folder(path.parent, ())
        return
    if not replace:
        raise UsageError(
            "the folder exists already", where=path, fix="name another, or add --force"
        )
    if not path.is_dir() or (any(path.iterdir()) and not (path / mark).is_file()):
        kind = "a benchmark folder" if mark == MARK else "such a folder"
        raise UsageError(
            f"is not {kind}, and so is not replaced",
            where=path,
            expected=f"a folder with {mark}, or none",
            fix="name another folder",
        )
