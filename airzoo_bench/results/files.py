"""Results as people name them: files or folders, their records, and what methods are called."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from itertools import takewhile
from pathlib import Path

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.results.result import Result, read_result
from airzoo_bench.storage.urls import ensure_file, fetch, url_of

_FILE = "result.json"
_RECORDS = "records.csv"


def result_paths(given: Sequence[Path]) -> tuple[Path, ...]:
    """Return the files that are meant: of a folder, the ``result.json`` in it."""
    paths = tuple(path / _FILE if path.is_dir() else path for path in given)
    for folder, path in zip(given, paths, strict=True):
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


def results_here(given: Sequence[str | Path]) -> list[Path]:
    """Return results as paths of this machine, and copy those at URLs."""
    urls = [url_of(location) for location in given]
    return [
        Path(location) if url is None else _fetch_result(url)
        for location, url in zip(given, urls, strict=True)
    ]


def _fetch_result(url: str) -> Path:
    """Copy a result; its records follow when they are asked for (`records_path`)."""
    is_file = url.partition("?")[0].endswith(".json")
    return fetch(url if is_file else f"{url.rstrip('/')}/{_FILE}")


def records_path(path: Path) -> Path:
    """Return where the records of a result lie."""
    places = [path.with_name(name) for name in (f"{path.stem}.{_RECORDS}", _RECORDS)]
    there = [place for place in places if place.is_file()]
    if len(there) == 1:
        return there[0]
    there = [place for place in map(ensure_file, places) if place.is_file()]
    with suppress(ResultError):  # which whoever reads the result will say
        stated = read_result(path).records_sha256 if there else ""
        there.sort(key=lambda place: sha256_of(place) != stated)
    return next(iter(there), path.with_name(_RECORDS))


def method_names(
    paths: Sequence[Path], results: Sequence[Result], *, by_protocol: bool = True
) -> list[str]:
    """Return the methods' names, and add parts of the files' paths where several are alike.

    Where `by_protocol`, results that do not measure the same may have the same method's name.
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
    first = _count_alike(parts)
    last = _count_alike([part[first:][::-1] for part in parts])
    cut = ["/".join(part[first : len(part) - last]) for part in parts]
    return cut if all(cut) else [str(path) for path in paths]


def _count_alike(parts: Sequence[Sequence[str]]) -> int:
    """Count the leading parts that all have."""
    same = (len(set(these)) == 1 for these in zip(*parts, strict=False))
    return sum(1 for _ in takewhile(bool, same))
