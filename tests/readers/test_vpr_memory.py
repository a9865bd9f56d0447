"""Log folders of VPR-methods-evaluation, read in pieces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from airzoo_bench.retrieval.descriptor_rows import RowParts, RowSource

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


def test_rows_of_several_arrays() -> None:
    whole = np.arange(24.0).reshape(8, 3)
    parts = RowParts.of((whole[:3], whole[3:4], whole[4:]))
    assert parts.shape == (8, 3)
    assert np.array_equal(parts.read(2, 7), whole[2:7])
    assert np.array_equal(parts.part(2, 7).read(1, 4), whole[3:6])
    assert np.array_equal(parts.take(np.array([7, 0, 3])), whole[[7, 0, 3]])
    assert [(start, rows.tolist()) for start, rows in parts.blocks(3)] == [
        (start, whole[start : start + 3].tolist()) for start in (0, 3, 6)
    ]
    assert isinstance(parts.part(5, 8), RowSource)
    assert [parts.part(at, at).shape for at in (0, 3, 8)] == [(0, 3)] * 3
