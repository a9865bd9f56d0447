"""What a run leaves in its folder, in place of what an earlier run left there."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.files import atomic_entries, sha256_of
from airzoo_bench.core.places import check_output_folder
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.results.records_csv import csv_blocks
from airzoo_bench.results.result import read_result, write_result

__all__ = ["check_run_folder", "earlier_run", "save"]

_ALWAYS = ("result.json", "records.csv")


def _run_files() -> tuple[str, ...]:
    """Name the files that runs of any track can leave in their folder."""
    tracks = [TRACKS.get(name) for name in TRACKS.names()]
    return (*_ALWAYS, *dict.fromkeys(name for track in tracks for name in track.files))


def _run_entries() -> tuple[str, ...]:
    """Name the files and folders that runs of any track can leave."""
    options = [option for name in TRACKS.names() for option in TRACKS.get(name).options]
    return (*_run_files(), *dict.fromkeys(one.name for one in options if one.needs_out))


def check_run_folder(folder: Path) -> None:
    """Refuse, before any work, a folder that a run cannot be saved in."""
    check_output_folder(folder, _run_files())


def save(evaluation: Evaluation, folder: Path) -> list[Path]:
    """Write the files of a run into a folder, in place of an earlier run's.

    Everything is written first, then exchanged in one step: nothing of the two runs is ever mixed.

    Parameters
    ----------
    evaluation : Evaluation
    folder : Path
        What is not of a run stays.

    Returns
    -------
    list of Path
        The files, ``result.json`` first.
    """
    check_run_folder(folder)
    with atomic_entries(folder, _run_entries()) as staged:
        with (staged / "records.csv").open("wb") as stream:
            for block in csv_blocks(evaluation.records):
                stream.write(block)
        result = evaluation.result.with_records(sha256_of(staged / "records.csv"))
        write_result(staged / "result.json", result)
        for name, write in evaluation.given.track.files.items():
            write(evaluation, staged / name)
        return [folder / name for name in _run_files() if (staged / name).exists()]


def earlier_run(folder: Path) -> str | None:
    """Say which run has left its files in a folder, where `save` will replace them."""
    names = ", ".join(name for name in _run_entries() if (folder / name).exists())
    if not names:
        return None
    try:
        found = read_result(folder / "result.json")
    except ResultError:  # none, or one that nobody can read any more
        return f"{folder} holds files of a run; {names} will be replaced"
    written = datetime.fromtimestamp((folder / "result.json").stat().st_mtime)
    return (
        f"{folder} holds a run of the {found.track} track: {found.predictions.method} by "
        f"{found.protocol.name} v{found.protocol.version}, written {written:%Y-%m-%d %H:%M}; "
        f"{names} will be replaced"
    )
