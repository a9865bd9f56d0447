"""What a run leaves in its folder, in place of what an earlier run left there."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path, PurePath

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.core.files import atomic_entries, check_output_folder, fingerprint, only_run
from airzoo_bench.core.registry import TRACKS, resolve
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.results.records import write_csv
from airzoo_bench.results.result import read_result, write_result
from airzoo_bench.storage.mirror import check_writable, uploaded
from airzoo_bench.storage.remote import cache_folder, find
from airzoo_bench.storage.urls import url_of

__all__ = [
    "check_run_folder",
    "earlier_run",
    "kept_beside",
    "only_run_at",
    "run_folder",
    "save",
]

_ALWAYS = ("result.json", "records.csv")


def _run_files() -> tuple[str, ...]:
    """Name the files that runs of any track can leave in their folder."""
    tracks = [TRACKS.get(name) for name in TRACKS.names()]
    of_tracks = dict.fromkeys(name for track in tracks for name in track.files)
    return (*_ALWAYS, *of_tracks)


def _run_folders() -> dict[str, str]:
    """Name the folders that runs of any track can leave, with a pattern of the files in each."""
    patterns: dict[str, str] = {}
    for one in (option for name in TRACKS.names() for option in TRACKS.get(name).options):
        if one.needs_out:
            patterns[one.name] = f"{patterns.get(one.name, '')}|(?:{one.files})".lstrip("|")
    return patterns


def _run_entries() -> tuple[str, ...]:
    """Name the files and folders that runs of any track can leave."""
    return (*_run_files(), *_run_folders())


def check_run_folder(folder: str | Path, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse, before any work, a folder or a URL that a run cannot be saved in."""
    url = url_of(folder)
    if url is None:
        check_output_folder(Path(folder), _run_files())
    else:
        check_writable(url)
    for one in inputs:
        _refuse_loss(folder, one)
    if url is None:
        for name, pattern in _run_folders().items():
            _refuse_others(Path(folder, name), rf"\..*|{pattern}")


def _refuse_others(place: Path, pattern: str) -> None:
    """Refuse to replace a folder with files in it that no run wrote."""
    entries = sorted(place.iterdir()) if place.is_dir() else [place] if place.exists() else []
    for one in entries:
        if one == place or one.is_dir() or not re.fullmatch(pattern, one.name):
            raise UsageError(
                f"no run wrote this, and a run would replace {place.name}",
                where=one,
                fix="move it elsewhere, or name another --out",
            )


def _refuse_loss(folder: str | Path, given: str | Path) -> None:
    """Refuse to replace an input, or a file that it leads to."""
    home = _real_place(folder)
    for place in _places(given):
        for name in _run_entries():
            if place.is_relative_to(home / name):
                raise UsageError(
                    f"the run would replace {name} in --out {folder}, and these with it",
                    where=given,
                    expected="predictions and other inputs outside of what a run writes",
                    fix="name another --out",
                )


def _real_place(location: str | Path) -> PurePath:
    url = url_of(location)
    return Path(location).resolve() if url is None else PurePath(f"{url.scheme}:", url.path)


def _places(given: str | Path) -> Iterator[PurePath]:
    """Yield where an input lies: as it is named, and where links to it and within it lead."""
    yield _real_place(given)
    if url_of(given) is None:
        path = Path(given)
        yield path.parent.resolve() / path.name
        yield from (one.resolve() for one in path.rglob("*") if one.is_symlink())


def kept_beside(out: str | Path | None) -> Path | None:
    """Return the place of this machine beside which finished tasks of a run are kept."""
    url = None if out is None else url_of(out)
    if out is None or url is None:
        place = None if out is None else Path(out)
        return place and (place if place.name not in ("", "..") else place.resolve())
    return cache_folder() / f"run-{fingerprint(str(url))[:12]}"


@contextmanager
def only_run_at(out: str | Path | None) -> Iterator[None]:
    """Keep other runs of this machine from a place where one is to be saved."""
    place = kept_beside(out)
    if place is None:
        yield
        return
    with only_run(place, "another run is to be saved here", f"--out {out}", "name another --out"):
        yield


@contextmanager
def run_folder(out: str | Path) -> Iterator[Path]:
    """Give the folder to save a run in; what was saved for a URL is uploaded at the end."""
    url = url_of(out)
    if url is None:
        yield Path(out)
        return
    with uploaded(url, _ALWAYS[0], _run_entries()) as folder:
        yield folder


def save(
    evaluation: Evaluation,
    folder: Path,
    draw: Callable[[Path], None] | None = None,
) -> list[Path]:
    """Write the files of a run into a folder, in place of an earlier run's."""
    check_run_folder(folder, [evaluation.given.predictions.path])
    with atomic_entries(folder, _run_entries()) as staged:
        checksum = write_csv(evaluation.records, staged / "records.csv")
        result = evaluation.result.with_records(checksum)
        write_result(staged / "result.json", result)
        for name, write in TRACKS.get(result.track).files.items():
            resolve(write)(evaluation, staged / name)
        if draw is not None:
            draw(staged)
        return [folder / name for name in _run_files() if (staged / name).exists()]


def earlier_run(out: str | Path) -> str | None:
    """Say which run has left its files in a folder, where `save` will replace them."""
    url = url_of(out)
    if url is not None:
        there = find(url.child(_ALWAYS[0])) is not None
        return f"{url} holds a run, which will be replaced" if there else None
    folder = Path(out)
    names = ", ".join(name for name in _run_entries() if (folder / name).exists())
    if not names:
        return None
    try:
        found = read_result(folder / "result.json")
    except ResultError:  # none, or one that nobody can read any more
        return f"{folder} holds files of a run; this one takes the place of {names}"
    written = datetime.fromtimestamp((folder / "result.json").stat().st_mtime)
    return (
        f"{folder} holds a run of the {found.track} track: {found.predictions.method} by "
        f"{found.protocol.name} v{found.protocol.version}, written {written:%Y-%m-%d %H:%M}; "
        f"this one takes the place of {names}"
    )
