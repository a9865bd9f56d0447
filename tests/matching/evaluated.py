"""Predictions of the made world, scored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.evaluation.evaluate import Evaluation, evaluate
from airzoo_bench.evaluation.track import Run
from tests.matching.world import (
    World,
)


def evaluated(world: World, folder: Path, fields: dict[str, Any]) -> Evaluation:
    path = world.write(folder / "method.npz", fields)
    return evaluate(path, track="matching", data=world.root, run=Run(keep=True))


def records(world: World, folder: Path, fields: dict[str, Any]) -> pd.DataFrame:
    return evaluated(world, folder, fields).records


def noisy(world: World, order: list[int]) -> dict[str, Any]:
    """Return matches with noise and outliers, the queries in some order."""
    query_xy = []
    for query, xy in enumerate(world.query_xy):
        random = np.random.default_rng(query)
        moved = xy + random.normal(0, 1.0, xy.shape)
        moved[:20] = random.random((20, 2)) * (640, 480)
        query_xy.append(np.clip(moved, 0, (640, 480)))
    fields = world.correspondences(
        [query_xy[q] for q in order], map_xy=[world.map_xy[q] for q in order]
    )
    return fields | {"query_ids": np.array([world.ids[q] for q in order])}
