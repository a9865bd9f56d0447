"""Predictions of both scenes of the made world."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from airzoo_bench.evaluation.evaluate import check
from tests.reconstruction.world import (
    PROTOCOL,
    World,
    predict_clouds,
    true_points,
)


def both(world: World, folder: Path, shift: float = 0.0) -> Path:
    clouds = {name: true_points(name) + np.array((0, 0, shift)) for name in ("yard", "lot")}
    return predict_clouds(world, folder / "p", clouds, cameras=False)


def notes_of(world: World, path: Path, protocol: str = PROTOCOL) -> list[str]:
    """Return the notes of an evaluation, which are those of a check."""
    notes = list(world.score(path, protocol=protocol).result.notes)
    checked = check(path, data=world.root, protocol=protocol)
    assert not checked.errors
    assert sorted(checked.notes) == sorted(notes)
    return notes
