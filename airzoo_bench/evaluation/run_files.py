"""The files that a run leaves in its folder, and the scored scenes that it keeps until then."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.core.files import (
    PART,
    atomic_entries,
    atomic_write,
    check_output_folder,
    fingerprint,
    only_run,
)
from airzoo_bench.core.registry import TRACKS, resolve
from airzoo_bench.evaluation.track import Scored
from airzoo_bench.results.records import write_csv
from airzoo_bench.results.result import read_result, write_result

if TYPE_CHECKING:
    from airzoo_bench.evaluation.evaluate import Evaluation

_RESULT = "result.json"
_RECORDS, _REST = ".records", ".scene"


def _run_entries() -> tuple[list[str], dict[str, str]]:
    """Name the files that runs of any track leave, and folders with a pattern of their files."""
    files, folders = [_RESULT, "records.csv"], dict[str, str]()
    for info in map(TRACKS.get, TRACKS.names()):
        files += info.files
        for option in info.options:
            known = folders.get(option.name, r"\..*")
            folders[option.name] = f"{known}|(?:{option.files})"
    return files, folders


def check_run_folder(out: Path, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse, before any work, a folder that a run cannot be saved in."""
    files, folders = _run_entries()
    check_output_folder(out, files)
    home = out.resolve()
    for one in map(Path, inputs):
        links = [one, *(path for path in one.rglob("*") if path.is_symlink())]
        places = [one.parent.resolve() / one.name, *(path.resolve() for path in links)]
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
    for name, pattern in folders.items():
        place = out / name
        for one in [*sorted(place.iterdir())] if place.is_dir() else [place] * place.exists():
            if one == place or one.is_dir() or not re.fullmatch(pattern, one.name):
                raise UsageError(
                    f"no run wrote this, and a run would replace {name}",
                    where=one,
                    fix="move it elsewhere, or name another --out",
                )


def only_run_at(out: Path) -> AbstractContextManager[None]:
    """Keep other runs of this machine from a place where one is to be saved."""
    what, otherwise = "another run is to be saved here", "name another --out"
    return only_run(out.resolve(), what, f"--out {out}", otherwise)


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


def describe_earlier_run(out: Path) -> str | None:
    """Say which files of a run `save` will replace, if it replaces some."""
    files, folders = _run_entries()
    names = ", ".join(name for name in (*files, *folders) if (out / name).exists())
    if not names:
        return None
    try:
        found = read_result(out / _RESULT)
    except ResultError:  # none, or one that nobody can read any more
        return f"{out} holds files of a run; this one takes the place of {names}"
    what = f"{found.predictions.method} by {found.protocol.name}"
    return f"{out} holds a run, {what}; this one takes the place of {names}"


class SceneStore:
    """Keeps the scores of scenes in a folder until the run is saved."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._run = ""

    def begin(self, run: str) -> None:
        """Set the fingerprint of the run: scenes of other runs are not loaded."""
        self._run = run

    def paths(self) -> list[Path]:
        """Return a file of each scene that is kept."""
        return list(self.folder.glob(f"*{_REST}"))

    def load(self, scene: str) -> Scored | None:
        """Return what this run has kept of a scene, if it is there and whole."""
        place = self._place(scene)
        try:
            rest = json.loads(place.with_suffix(_REST).read_text("utf-8"))
            records = pd.read_parquet(place.with_suffix(_RECORDS))
            return Scored(records, **(rest | {"notes": tuple(rest["notes"])}))
        except (OSError, ValueError, KeyError, TypeError):  # there is none, or it is damaged
            return None

    def save(self, scene: str, scored: Scored) -> None:
        """Keep the scores of a scene, without what figures show of it."""
        place = self._place(scene)
        rest = {name: getattr(scored, name) for name in ("counts", "kind", "notes", "facts")}
        with atomic_write(place.with_suffix(_RECORDS)) as stream:
            scored.records.to_parquet(stream)
        with atomic_write(place.with_suffix(_REST), "w") as text:
            json.dump(rest, text)

    def remove(self) -> None:
        """Remove what is kept, and nothing else."""
        with suppress(OSError):  # there is none, or something else is in it
            for path in self.folder.iterdir():
                if path.name.endswith((_RECORDS, _REST, PART)):
                    path.unlink()
            self.folder.rmdir()

    def _place(self, scene: str) -> Path:
        return self.folder / fingerprint([self._run, scene])[:32]
