"""The files that a run leaves in its folder, in place of an earlier run's."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path, PurePath

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.core.files import atomic_entries, check_output_folder, fingerprint, only_run
from airzoo_bench.core.registry import TRACKS, resolve
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.results.records import write_csv
from airzoo_bench.results.result import read_result, write_result
from airzoo_bench.storage.mirror import check_writable, uploaded
from airzoo_bench.storage.remote import find
from airzoo_bench.storage.urls import cache_folder, url_of

_RESULT = "result.json"


def _run_entries() -> tuple[list[str], dict[str, str]]:
    """Name the files that runs of any track leave, and folders with a pattern of their files."""
    files, folders = [_RESULT, "records.csv"], dict[str, str]()
    for info in map(TRACKS.get, TRACKS.names()):
        files += info.files
        for option in info.options:
            known = folders.get(option.name, r"\..*")
            folders[option.name] = f"{known}|(?:{option.files})"
    return files, folders


def check_run_folder(out: str | Path, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse, before any work, a folder or a URL that a run cannot be saved in."""
    url, (files, folders) = url_of(out), _run_entries()
    if url is not None:
        check_writable(url)
    else:
        check_output_folder(Path(out), files)
    home = _real_place(out)
    for one in inputs:
        places = [*_real_places(one)]
        lost = [
            name for name in (*files, *folders) for p in places if p.is_relative_to(home / name)
        ]
        if lost:
            raise UsageError(
                f"the run would replace {lost[0]} in --out {out}, and these with it",
                where=one,
                expected="predictions and other inputs outside of what a run writes",
                fix="name another --out",
            )
    for name, pattern in {} if url is not None else folders.items():
        place = Path(out, name)
        for one in [*sorted(place.iterdir())] if place.is_dir() else [place] * place.exists():
            if one == place or one.is_dir() or not re.fullmatch(pattern, one.name):
                raise UsageError(
                    f"no run wrote this, and a run would replace {name}",
                    where=one,
                    fix="move it elsewhere, or name another --out",
                )


def _real_place(location: str | Path) -> PurePath:
    url = url_of(location)
    return Path(location).resolve() if url is None else PurePath(f"{url.scheme}:", url.path)


def _real_places(location: str | Path) -> Iterator[PurePath]:
    """Yield where an input lies: as it is named, and where links to it and within it lead."""
    yield _real_place(location)
    if url_of(location) is None:
        path = Path(location)
        yield path.parent.resolve() / path.name
        yield from (one.resolve() for one in path.rglob("*") if one.is_symlink())


def local_place(out: str | Path | None) -> Path | None:
    """Return the local path that represents the output of a run, which may be a URL."""
    if out is None:
        return None
    url = url_of(out)
    if url is not None:
        return cache_folder() / f"run-{fingerprint(str(url))[:12]}"
    place = Path(out)
    return place if place.name not in ("", "..") else place.resolve()


def only_run_at(out: str | Path | None) -> AbstractContextManager[None]:
    """Keep other runs of this machine from a place where one is to be saved."""
    place = local_place(out)
    if place is None:
        return nullcontext()
    return only_run(place, "another run is to be saved here", f"--out {out}", "name another --out")


@contextmanager
def run_folder(out: str | Path) -> Iterator[Path]:
    """Return the folder to save a run in; for a URL its files are uploaded at the end."""
    url = url_of(out)
    if url is None:
        yield Path(out)
        return
    files, folders = _run_entries()
    with uploaded(url, _RESULT, (*files, *folders)) as folder:
        yield folder


def save(
    evaluation: Evaluation, folder: Path, draw: Callable[[Path], None] | None = None
) -> list[Path]:
    """Write the files of a run into a folder, in place of an earlier run's."""
    check_run_folder(folder, [evaluation.given.predictions.path])
    files, folders = _run_entries()
    with atomic_entries(folder, (*files, *folders)) as staged:
        checksum = write_csv(evaluation.records, staged / "records.csv")
        result = evaluation.result.with_records(checksum)
        write_result(staged / _RESULT, result)
        for name, write in TRACKS.get(result.track).files.items():
            resolve(write)(evaluation, staged / name)
        if draw is not None:
            draw(staged)
        return [folder / name for name in files if (staged / name).exists()]


def describe_earlier_run(out: str | Path) -> str | None:
    """Say which files of a run `save` will replace, if it replaces some."""
    url = url_of(out)
    if url is not None:
        there = find(url.child(_RESULT)) is not None
        return f"{url} holds a run, which will be replaced" if there else None
    files, folders = _run_entries()
    names = ", ".join(name for name in (*files, *folders) if Path(out, name).exists())
    if not names:
        return None
    try:
        found = read_result(Path(out, _RESULT))
    except ResultError:  # none, or one that nobody can read any more
        return f"{out} holds files of a run; this one takes the place of {names}"
    what = f"{found.predictions.method} by {found.protocol.name}"
    return f"{out} holds a run, {what}; this one takes the place of {names}"
