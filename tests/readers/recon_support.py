"""What the tests of readers of reconstructions share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.opening import ReadBy
from airzoo_bench.evaluation.reader import find_reader
from tests.readers.samples.true_views import SCALE, Array, true_views
from tests.reconstruction.world import World, camera_poses, make_world, replace_cloud


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    """Return a world whose true clouds are what its views see, so that nothing is missed."""
    made = make_world(tmp_path_factory.mktemp("world") / "data")
    for scene in ("yard", "lot"):
        views = true_views(made, scene)
        seen = views.points[views.depth > 0]
        replace_cloud(made, scene, placed(seen, scene))
    return made


def placed(points: Array, scene: str) -> Array:
    """Bring points of a method's frame to the scene's."""
    poses = camera_poses(scene)
    found: Array = points @ poses.rotation[0] / SCALE + poses.centres[0]
    return found


def scored(world: World, path: Path, reader: str | None = None, **options: Any) -> Evaluation:
    """Score a path, read by the reader that recognises it."""
    names = options.pop("names", None)
    found = world.score(path, read_by=ReadBy(reader, names), **options)
    assert found.given.reader is not None
    assert found.given.reader.name == (reader or find_reader(path))
    return found


def row(found: Evaluation) -> dict[str, str]:
    """Return the scores as they are printed."""
    return {name: f"{value:.4f}" for name, value in found.result.overall.items()}


def check_perfect(
    found: Evaluation, tolerance_m: float = 1e-4, notes: tuple[str, ...] = ()
) -> None:
    overall = found.result.overall
    assert overall["f1_0.2m"] == 1.0
    assert overall["chamfer_m"] < tolerance_m
    assert overall["ate_m"] < tolerance_m
    assert overall["pose_auc_3deg"] > 0.999
    assert found.result.notes == notes
