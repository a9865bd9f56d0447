"""Results as people name them: files or folders, their records, and what methods are called."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from airzoo_bench.core.errors import ResultError
from airzoo_bench.results.result import Result
from airzoo_bench.storage.urls import ensure_file, fetch, url_of

_FILE = "result.json"


def result_paths(given: Sequence[Path]) -> tuple[Path, ...]:
    """Return the files that are meant: of a folder, the ``result.json`` in it."""
    paths = tuple(path / _FILE if path.is_dir() else path for path in given)
    for folder, path in zip(given, paths, strict=True):
        if folder != path and not path.is_file():
            inside = len(list(folder.glob(f"*/{_FILE}")))
            raise ResultError(
                f"a folder, not a result file, and without a {_FILE}",
                where=folder,
                expected=f"a {_FILE}, or the folder that holds it",
                fix=f"name {folder}/*/{_FILE} (there are {inside})" if inside else None,
            )
    return tuple(dict.fromkeys(paths))


def results_here(given: Sequence[str | Path]) -> list[Path]:
    """Return results as paths of this machine, and copy those at URLs."""
    found = []
    for location in given:
        url = url_of(location)
        if url is not None and not url.partition("?")[0].endswith(".json"):
            url = f"{url.rstrip('/')}/{_FILE}"
        found.append(Path(location) if url is None else fetch(url))
    return found


def records_path(path: Path) -> Path:
    """Return where the records of a result lie; a copied result has copied records."""
    return ensure_file(path.with_name("records.csv"))


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
        folders = [paths[place].parent for place in places]
        short = [folder.name for folder in folders]
        if len(set(short)) < len(places):
            short = [str(paths[place]) for place in places]
        for place, where in zip(places, short, strict=True):
            names[place] += f" ({where})" if len(places) > 1 else ""
    return names
