"""Scored scenes on disk: `eval --resume` continues a stopped run from them."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

import pandas as pd

from airzoo_bench.core.files import PART, atomic_write, fingerprint
from airzoo_bench.evaluation.track import Scored

_RECORDS, _REST = ".records", ".scene"


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
