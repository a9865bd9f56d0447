"""Predictions matched to the queries of the made world."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.matching.reading import read_matching
from airzoo_bench.matching.scene_predictions import ScenePredictions, match_scene
from tests.matching.world import N_QUERIES, World

EVERY = np.arange(N_QUERIES)


def matched(
    world: World, path: Path, fields: dict[str, Any], rows: np.ndarray[Any, Any] = EVERY
) -> ScenePredictions:
    predictions = read_matching(world.write(path / "preds.npz", fields), 1 << 30)
    return match_scene(predictions, world.truth, rows, world.protocol.scores)


def refused(world: World, path: Path, fields: dict[str, Any]) -> str:
    with pytest.raises(PredictionError) as caught:
        matched(world, path, fields)
    assert "preds.npz, " in str(caught.value)
    return str(caught.value)
