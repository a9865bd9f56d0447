"""Predictions as they are listed, beside the scenes of a protocol."""

from __future__ import annotations

from dataclasses import dataclass

from airzoo_bench.core.errors import first_of
from airzoo_bench.core.plurals import counted
from airzoo_bench.core.validation import nearest
from airzoo_bench.reconstruction.reading import ReconstructionPredictions

__all__ = ["ListedScenes"]


@dataclass(frozen=True)
class ListedScenes:
    """Which of the `known` scenes there are entries of."""

    predictions: ReconstructionPredictions
    known: list[str]

    @property
    def strange(self) -> tuple[str, ...]:
        """Entries that are of no known scene."""
        return self.predictions.unknown(self.known)

    @property
    def covered(self) -> str:
        """How many scenes have an entry, such as ``2 of 3 scenes``."""
        missing = self.predictions.missing(self.known)
        return f"{len(self.known) - len(missing):,} of {counted(len(self.known), 'scene')}"

    def notes(self) -> list[str]:
        """Name the scenes and files that are not what they might be meant to be."""
        missing, notes = self.predictions.missing(self.known), []
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
