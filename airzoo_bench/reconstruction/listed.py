"""Predictions as they are listed, beside the scenes of a protocol."""

from __future__ import annotations

from dataclasses import dataclass

from airzoo_bench.core.errors import counted, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.track import ScenePredictions

__all__ = ["ListedScenes"]


@dataclass(frozen=True)
class ListedScenes:
    """Which of the `known` scenes there are entries of."""

    predictions: ScenePredictions
    known: list[str]

    @property
    def strange(self) -> tuple[str, ...]:
        """Entries that are of no known scene."""
        return tuple(one for one in self.predictions.scenes if one not in self.known)

    @property
    def missing(self) -> tuple[str, ...]:
        """Known scenes that there is no entry of."""
        return tuple(one for one in self.known if one not in self.predictions.scenes)

    @property
    def covered(self) -> str:
        """How many scenes have an entry, such as ``2 of 3 scenes``."""
        return f"{len(self.known) - len(self.missing):,} of {counted(len(self.known), 'scene')}"

    def notes(self) -> list[str]:
        """Name the scenes and files that are not what they might be meant to be."""
        missing, notes = self.missing, []
        if missing:
            named = _named(missing)
            notes.append(f"scenes that the predictions lack, scored at their worst: {named}")
        if self.strange:
            # What a mistyped name means is among the scenes that are missing.
            offered = [name[:80] + nearest(name[:80], list(missing), 1) for name in self.strange]
            notes.append(f"scenes that the protocol lacks, left aside: {first_of(offered)}")
        files = self.predictions.unknown_files
        begun = tuple(name for name in files if name in missing)
        if begun:
            what = "called as scenes, without all that one is read from, left aside"
            notes.append(f"{what}: {_named(begun)}")
        strays = tuple(name for name in files if name not in begun)
        if strays:
            notes.append(f"files that belong to no scene, left aside: {_named(strays)}")
        return notes


def _named(names: tuple[str, ...]) -> str:
    return first_of([name[:80] for name in names])
