"""The files that a run leaves in its folder, and the scored scenes that it keeps until then."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import (
    PART,
    atomic_entries,
    atomic_write,
    check_output_folder,
    fingerprint,
)
from airzoo_bench.core.registry import TRACKS, resolve
from airzoo_bench.evaluation.track import SceneScores
from airzoo_bench.results.records import write_csv
from airzoo_bench.results.result import write_result

if TYPE_CHECKING:
    from airzoo_bench.evaluation.evaluate import Evaluation

_RESULT = "result.json"
_SCENE = ".scene"


def check_run_folder(out: Path, predictions: str | Path) -> tuple[list[str], set[str]]:
    """Refuse, before any work, a folder where a run would replace predictions or a user's own.

    Return the names of the files and of the folders that runs of any track leave.
    """
    tracks = [TRACKS.get(name) for name in TRACKS.names()]
    files, folders = [_RESULT, "records.csv"], {"figures"}
    files += [name for info in tracks for name in info.files]
    check_output_folder(out, files)
    given, is_run = Path(predictions).resolve(), (out / _RESULT).exists()
    for name in (*files, *folders):
        is_own = name in folders and (out / name).exists() and not is_run
        if is_own or given.is_relative_to(out.resolve() / name):
            raise UsageError(
                f"the run would replace {name}, which no run wrote",
                where=out / name,
                fix="move it elsewhere, or name another --out",
            )
    return files, folders


def save(
    evaluation: Evaluation, folder: Path, draw: Callable[[Path], None] | None = None
) -> list[Path]:
    """Write the files of a run into a folder, in place of an earlier run's."""
    files, folders = check_run_folder(folder, evaluation.given.predictions.path)
    with atomic_entries(folder, (*files, *folders)) as staged:
        checksum = write_csv(evaluation.records, staged / "records.csv")
        result = evaluation.result.with_records(checksum)
        write_result(staged / _RESULT, result)
        for name, write in TRACKS.get(result.track).files.items():
            resolve(write)(evaluation, staged / name)
        if draw is not None:
            draw(staged)
        return [folder / name for name in files if (staged / name).exists()]


class SceneStore:
    """Keeps the scores of scenes in a folder until the run is saved."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._run = ""

    def begin(self, run: str) -> None:
        """Set the fingerprint of the run: scenes of other runs are not loaded."""
        self._run = run

    def load(self, scene: str) -> SceneScores | None:
        """Return what this run has kept of a scene, if it is there and whole."""
        try:
            records = pd.read_parquet(self._place(scene))
            rest, records.attrs = records.attrs, {}
            return SceneScores(records, **(rest | {"notes": tuple(rest["notes"])}))
        except (OSError, ValueError, KeyError, TypeError):  # there is none, or it is damaged
            return None

    def save(self, scene: str, scored: SceneScores) -> None:
        """Keep the scores of a scene, without what figures show of it."""
        records = scored.records.copy(deep=False)
        names = ("counts", "kind", "notes", "facts")
        records.attrs = {name: getattr(scored, name) for name in names}
        with atomic_write(self._place(scene)) as stream:
            records.to_parquet(stream)

    def remove(self) -> None:
        """Remove what is kept, and nothing else."""
        with suppress(OSError):  # there is none, or something else is in it
            for path in self.folder.iterdir():
                if path.name.endswith((_SCENE, PART)):
                    path.unlink()
            self.folder.rmdir()

    def _place(self, scene: str) -> Path:
        return self.folder / (fingerprint([self._run, scene])[:32] + _SCENE)
