"""The benchmark of two scenes whose gallery is written in shards."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.retrieval.gallery_files import SCENES
from tests.support import made_protocol, write_benchmark


@pytest.fixture(scope="module")
def shard_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_benchmark(tmp_path_factory.mktemp("data") / "made", made_protocol(SCENES), SCENES)
