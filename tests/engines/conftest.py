"""A cluster of Dask on this machine; it ends with its file, since it works while it waits."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from airzoo_bench.engines.dask import local_cluster
from airzoo_bench.engines.engine import Engine


@pytest.fixture(scope="module")
def dask() -> Iterator[Engine]:
    """Return its engine; libraries of this process keep their threads, unlike those of workers."""
    before = dict(os.environ)
    with local_cluster(2) as made:
        assert dict(os.environ) == before
        yield made
