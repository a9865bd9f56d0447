"""Log folders of VPR-methods-evaluation, read in pieces."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.readers.retrieval_support import (
    Place,
    scored,
)
from tests.readers.samples import vpr
from tests.support import MadeScene


def test_a_gallery_larger_than_the_memory(tmp_path: Path) -> None:
    scene = MadeScene("east", [[0]], 400)
    data = Place([scene]).prepare(tmp_path / "data")
    rows = np.random.default_rng(0).standard_normal((400, 5000), np.float32)
    vpr.write_log(tmp_path / "log", scene)
    np.save(tmp_path / "log" / "database_descriptors.npy", rows)
    np.save(tmp_path / "log" / "queries_descriptors.npy", rows[:1])
    assert rows.nbytes > 4e6
    assert scored(tmp_path / "log", data, max_memory=2_000_000).overall["recall@1"] == 1.0
