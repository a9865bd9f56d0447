"""AerialExtreMatch: (N, 4) of original pixels a query."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.matching.world import World
from tests.readers.samples.matchers import pairs


def write(folder: Path, world: World) -> Path:
    home = folder / "aerialextrematch"
    home.mkdir()
    for pair in pairs(world):
        np.save(home / f"{pair.stem}.npy", np.hstack([pair.query_xy, pair.map_xy]))
    return home
