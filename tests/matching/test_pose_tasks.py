"""Poses solved as tasks: the same records, whatever the engine and its cuts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.engines.engine import HERE
from airzoo_bench.evaluation.evaluate import Evaluation, evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.matching import solving
from airzoo_bench.matching.solving import PoseQueries, solve_queries
from airzoo_bench.results.records_csv import csv_blocks
from tests.engines.scattered import Scattered
from tests.matching.pose_support import SETTINGS, make_scene
from tests.matching.world import World
from tests.support import run_main


class Kept(Scattered):
    """Keeps what tasks gave, and their names."""

    def __init__(self, size: int | None = None) -> None:
        super().__init__(size)
        self.results: list[dict[str, Any]] = []
        self.names: list[str] = []

    def map(
        self,
        work: Callable[..., Any],
        items: Sequence[Any],
        *,
        shared: Any,
        stage: str,
        name: Callable[[Any], str],
    ) -> Iterator[Any]:
        self.names += map(name, items)
        for result in super().map(work, items, shared=shared, stage=stage, name=name):
            self.results.append(result)
            yield result


@pytest.fixture
def predictions(world: World, tmp_path: Path) -> Path:
    """Matches of which some are wrong, of one query too few, of another outside the map."""
    query_xy, map_xy = [], []
    for query, (seen, found) in enumerate(zip(world.query_xy, world.map_xy, strict=True)):
        random = np.random.default_rng(query)
        wrong = random.random(len(seen)) < 0.3
        seen = np.where(wrong[:, None], random.random(seen.shape) * (640, 480), seen)
        keep = slice(2) if query == 1 else slice(None)
        query_xy.append(seen[keep])
        map_xy.append(found[keep])
    return world.write(tmp_path / "m.npz", world.correspondences(query_xy, map_xy=map_xy))


def evaluated(world: World, predictions: Path, **resources: Any) -> Evaluation:
    return evaluate(predictions, data=world.root, run=Run(keep=True, **resources))


def csv_of(evaluation: Evaluation) -> bytes:
    return b"".join(csv_blocks(evaluation.records))


@pytest.fixture(autouse=True)
def _still_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tasks are done twice to compare what they give, and seconds would differ."""
    monkeypatch.setattr(solving, "perf_counter", lambda: 0.0)


@pytest.mark.parametrize("size", [1, 2, 3, None])
def test_records_do_not_depend_on_the_cut(
    world: World, predictions: Path, size: int | None
) -> None:
    here, cut = evaluated(world, predictions, jobs=2), Kept(size)
    there = evaluated(world, predictions, engine=cut)
    assert csv_of(there) == csv_of(here)
    assert {"solved", "too few matches"} <= set(here.records["status"])
    for name, whole in here.scored.items():
        scene, other = whole.details[1], there.scored[name].details[1]
        assert np.array_equal(other.centres, scene.centres, equal_nan=True)
        assert list(map(len, scene.inliers)) == here.records["matches"].tolist()
        for mine, theirs in zip(scene.inliers, other.inliers, strict=True):
            assert np.array_equal(mine, theirs)
    assert len(cut.results) == -(-5 // (size or 1))


def test_tasks_give_arrays_that_need_no_pickle(world: World, predictions: Path) -> None:
    engine = Kept(2)
    evaluated(world, predictions, engine=engine)
    assert engine.names[1:] == ["queries 3 to 4 of scene hills", "queries 5 to 5 of scene hills"]
    for result in engine.results:
        assert all(isinstance(array, np.ndarray) for array in result.values())
        assert not any(array.dtype.hasobject for array in result.values())


def test_few_queries_are_a_task_each() -> None:
    sizes = [solving._queries_a_task(count, 1) for count in (1, 351, 40_000, 10_000_000)]
    assert sizes == [1, 1, 4, 64]
    assert solving._queries_a_task(351, 2) == 32  # of which two threads take one each


def test_a_scene_without_queries() -> None:
    cameras = make_scene(0).problem.camera.take(slice(0))
    nothing = np.zeros(1, np.int64), np.zeros((0, 2)), np.zeros((0, 3))
    none = PoseQueries("scene a", cameras, *nothing)
    for engine in (HERE, Scattered()):
        found = solve_queries(none, SETTINGS, Run(engine=engine))
        assert found.rotations.shape == (0, 3, 3)
        assert found.status == []


def test_workers_of_dask_give_the_same_files(
    world: World, predictions: Path, tmp_path: Path
) -> None:
    command = ("eval", "matching", predictions, "--data", world.root, "--format", "json")
    for name, options in (("a", ()), ("b", ("--engine", "dask", "--jobs", 2))):
        assert run_main(*command, "--out", tmp_path / name, "--method", "m", *options) == 0
    for file in ("records.csv", "result.json"):
        assert (tmp_path / "b" / file).read_bytes() == (tmp_path / "a" / file).read_bytes()
    timings = [pd.read_csv(tmp_path / name / "timings.csv") for name in "ab"]
    assert [*timings[1]] == ["scene", "query", "seconds"]
    assert timings[1]["query"].equals(timings[0]["query"])
