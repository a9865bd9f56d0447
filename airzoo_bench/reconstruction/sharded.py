"""Work done on a cloud shard by shard, each a task."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.formats.clouds.cloud import CloudSource, Shard, shards_of

__all__ = ["over_shards"]

S = TypeVar("S")
R = TypeVar("R")


def over_shards(
    work: Callable[[S, Shard], R], cloud: CloudSource, shared: S, engine: Engine
) -> Iterator[R]:
    """Yield what ``work(shared, shard)`` returns, in the order of a cloud's shards."""
    shards = shards_of(cloud)
    where = engine if len(shards) > 1 else HERE
    return where.map(work, shards, shared=shared, stage="shards", name=lambda shard: shard.name)
