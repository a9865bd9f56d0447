"""Clouds in shards on real workers, one of which dies on the way."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("distributed", reason="needs the extra dask")

from airzoo_bench.engines.dask import local_cluster
from airzoo_bench.engines.engine import Engine
from airzoo_bench.reconstruction.distances import clouds as clouds_module
from airzoo_bench.reconstruction.distances.clouds import cloud_distances
from airzoo_bench.reconstruction.distances.neighbours import mutual_distances
from tests.reconstruction.cloud_support import surface
from tests.reconstruction.shard_support import in_shards, opened, write_parquet

GIB = 1 << 30


def dying(flags: Path, work: Callable[[Any, Any], Any], shared: Any, item: Any) -> Any:
    """Do a task; the first of each kind kills its worker when it is nearly done."""
    result = work(shared, item)
    try:
        (flags / work.__name__).touch(exist_ok=False)
    except FileExistsError:
        return result
    os.kill(os.getpid(), signal.SIGKILL)
    return None


class Mortal(Engine):
    """An engine whose tasks kill workers."""

    def __init__(self, engine: Engine, flags: Path) -> None:
        self._engine, self._flags = engine, flags

    def cut(self, count: int, size: int) -> list[slice]:
        return self._engine.cut(count, size)

    def map(
        self,
        work: Callable[[Any, Any], Any],
        items: Sequence[Any],
        *,
        shared: Any,
        stage: str,
        name: Callable[[Any], str],
    ) -> Iterator[Any]:
        mortal = partial(dying, self._flags, work)
        return self._engine.map(mortal, items, shared=shared, stage=stage, name=name)


@pytest.mark.parametrize("workers", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_distances_are_the_same_when_workers_die(
    workers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = surface(6000, 0, far=0.05), surface(5000, 1)
    prediction = opened(in_shards(tmp_path / "p", first, 4, write_parquet, ".parquet"))
    truth = opened(in_shards(tmp_path / "t", second, 3, write_parquet, ".parquet"))
    expected = mutual_distances(first, second, jobs=1)
    flags = tmp_path / "flags"
    flags.mkdir()
    monkeypatch.setattr(clouds_module, "_TILE", 500)
    with local_cluster(workers, GIB) as engine:
        found = cloud_distances(
            prediction, truth, block_points=10_000, jobs=1, engine=Mortal(engine, flags)
        )
    np.testing.assert_array_equal(found.to_truth, expected[0])
    np.testing.assert_array_equal(found.to_prediction, expected[1])
    assert {flag.name for flag in flags.iterdir()} == {"_spilled_shard", "tile_distances"}
