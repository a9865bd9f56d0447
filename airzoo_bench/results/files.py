"""Results as people name them: files or folders, their records, and what methods are called."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.core.temporaries import clear_abandoned
from airzoo_bench.results.result import Result

__all__ = ["method_names", "records_path", "result_paths"]

_FILE = "result.json"
_RECORDS = "records.csv"


def result_paths(given: Sequence[Path]) -> tuple[Path, ...]:
    """Return the files that are meant: of a folder, the ``result.json`` in it.

    Raises
    ------
    ResultError
        A folder holds none.
    UsageError
        A file is named twice.
    """
    paths = tuple(path / _FILE if path.is_dir() else path for path in given)
    for folder, path in zip(given, paths, strict=True):
        clear_abandoned(path.parent)
        if folder != path and not path.is_file():
            inside = sorted(folder.glob(f"*/{_FILE}"))
            raise ResultError(
                f"a folder, not a result file, and without a {_FILE}",
                where=folder,
                expected=f"a {_FILE}, or the folder that holds it",
                fix=f"name {folder}/*/{_FILE} (there are {len(inside)})" if inside else None,
            )
    for path, times in Counter(path.resolve() for path in paths).items():
        if times > 1:
            raise UsageError("named twice", where=path, fix="name each result once")
    return paths


def records_path(path: Path) -> Path:
    """Return where the records of a result lie.

    That is ``records.csv`` next to it; of ``a.json`` also ``a.records.csv``, so that several
    results can share a folder.
    """
    own = path.with_name(f"{path.stem}.{_RECORDS}")
    return own if own.is_file() else path.with_name(_RECORDS)


def method_names(
    paths: Sequence[Path], results: Sequence[Result], *, by_protocol: bool = True
) -> list[str]:
    """Return the methods' names; where several are alike, with what their files' paths differ in.

    Parameters
    ----------
    paths : sequence of Path
    results : sequence of Result
        As many.
    by_protocol : bool
        Whether results that do not measure the same may have the same method's name.
    """
    names = [result.predictions.method for result in results]
    alike: dict[tuple[str, ...], list[int]] = {}
    for place, result in enumerate(results):
        used = result.protocol
        measured = (used.name, used.fingerprint, result.truth.fingerprint) if by_protocol else ()
        alike.setdefault((*measured, names[place]), []).append(place)
    for places in alike.values():
        if len(places) > 1:
            for place, end in zip(places, _differing([paths[p] for p in places]), strict=True):
                names[place] += f" ({end})"
    return names


def _differing(paths: Sequence[Path]) -> list[str]:
    """Return paths without the folders at their beginning and end that all have."""
    parts = [path.parts for path in paths]
    first = _alike(parts)
    last = _alike([part[first:][::-1] for part in parts])
    cut = ["/".join(part[first : len(part) - last]) for part in parts]
    return cut if all(cut) else [str(path) for path in paths]


def _alike(parts: Sequence[Sequence[str]]) -> int:
    """Count the leading parts that all have."""
    same = (len(set(these)) == 1 for these in zip(*parts, strict=False))
    return sum(1 for _ in takewhile(bool, same))
