"""What a run leaves in its folder, in place of what an earlier run left there."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path, PurePath

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.core.files import atomic_entries, fingerprint, sha256_of
from airzoo_bench.core.only_run import only_run
from airzoo_bench.core.places import check_output_folder
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.engines.report import RunReport
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.results.files import RecordsKind
from airzoo_bench.results.records_csv import write_csv
from airzoo_bench.results.records_parquet import write_parquet
from airzoo_bench.results.result import read_result, write_result
from airzoo_bench.storage.cache import cache_folder
from airzoo_bench.storage.remote import find
from airzoo_bench.storage.uploads import check_writable, uploaded
from airzoo_bench.storage.urls import url_of

__all__ = [
    "check_run_folder",
    "earlier_run",
    "kept_beside",
    "only_run_at",
    "run_folder",
    "save",
]

_ALWAYS = ("result.json", *(kind.file for kind in RecordsKind))
_REPORT = "run_report.json"


def _run_files() -> tuple[str, ...]:
    """Name the files that runs of any track can leave in their folder."""
    tracks = [TRACKS.get(name) for name in TRACKS.names()]
    of_tracks = dict.fromkeys(name for track in tracks for name in track.files)
    return (*_ALWAYS, *of_tracks, _REPORT)


def _run_entries() -> tuple[str, ...]:
    """Name the files and folders that runs of any track can leave."""
    options = [option for name in TRACKS.names() for option in TRACKS.get(name).options]
    return (*_run_files(), *dict.fromkeys(one.name for one in options if one.needs_out))


def check_run_folder(folder: str | Path, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse, before any work, a folder or a URL that a run cannot be saved in.

    Parameters
    ----------
    folder : str or Path
    inputs : iterable of str or Path
        What the run is made from, and so must not be replaced by its files.

    Raises
    ------
    UsageError
        It cannot be written to, or an input is, or lies in, what a run replaces there; through
        links too.
    """
    url = url_of(folder)
    if url is None:
        check_output_folder(Path(folder), _run_files())
    else:
        check_writable(url)
    for one in inputs:
        _refuse_loss(folder, one)


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
    """Keep other runs of this machine from a place where one is to be saved.

    Raises
    ------
    UsageError
        Another run is to be saved there.
    """
    place = kept_beside(out)
    if place is None:
        yield
        return
    with only_run(place, "another run is to be saved here", f"--out {out}", "name another --out"):
        yield


@contextmanager
def run_folder(out: str | Path) -> Iterator[Path]:
    """Give the folder to save a run in; what was saved for a URL is uploaded at the end.

    ``result.json`` of an earlier run goes first and the new one comes last: a place without it
    holds no run, and the records of another run do not have the checksum that it states.

    Raises
    ------
    StorageError
        It cannot be uploaded; the message says where the run is kept.
    """
    url = url_of(out)
    if url is None:
        yield Path(out)
        return
    with uploaded(url, _ALWAYS[0], _run_entries()) as folder:
        yield folder


def save(
    evaluation: Evaluation,
    folder: Path,
    records: RecordsKind = RecordsKind.CSV,
    report: RunReport | None = None,
) -> list[Path]:
    """Write the files of a run into a folder, in place of an earlier run's.

    Everything is written first, then exchanged in one step: nothing of the two runs is ever mixed.

    Parameters
    ----------
    evaluation : Evaluation
    folder : Path
        What is not of a run stays.
    records : RecordsKind
        As what they are written.
    report : RunReport, optional
        What the run took.

    Returns
    -------
    list of Path
        The files, ``result.json`` first.
    """
    check_run_folder(folder, [evaluation.given.predictions.path])
    with atomic_entries(folder, _run_entries()) as staged:
        written = staged / records.file
        if records is RecordsKind.PARQUET:
            write_parquet(evaluation.records, written)
            checksum = sha256_of(written)
        else:
            checksum = write_csv(evaluation.records, written)
        result = evaluation.result.with_records(checksum)
        write_result(staged / "result.json", result)
        for name, write in evaluation.given.track.files.items():
            write(evaluation, staged / name)
        if report is not None:
            text = json.dumps(report.values(), indent=1) + "\n"
            (staged / _REPORT).write_text(text, encoding="utf-8")
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
