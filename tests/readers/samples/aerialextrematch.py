"""AerialExtreMatch: (N, 4) of original pixels a query, and the text of its localisation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.matching.world import World
from tests.readers.samples.matchers import pairs

RESULTS = "q0 0.52 0.31\nq1 nan 180\nMedian errors: 0.52m, 0.31deg\n"


def write(folder: Path, world: World) -> Path:
    home = folder / "aerialextrematch"
    home.mkdir()
    for pair in pairs(world):
        np.save(home / f"{pair.stem}.npy", np.hstack([pair.query_xy, pair.map_xy]))
    return home


def write_results(folder: Path, world: World) -> Path:
    path = folder / "results.txt"
    path.write_text(RESULTS)
    return path
