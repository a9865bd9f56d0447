"""Rows of compressed arrays, one in memory at a time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.formats.npz_rows import RowStream

VALUES = np.random.default_rng(0).random((7, 30, 40)).astype("f4")


def written(folder: Path) -> Path:
    np.savez_compressed(folder / "v.npz", depth=VALUES)
    return folder / "v.npz"


def test_rows_in_any_order(tmp_path: Path) -> None:
    rows = RowStream(NpzFile(written(tmp_path), 1 << 20), "depth", VALUES.shape)
    for row in (0, 0, 1, 4, 4, 2, 6, 0):
        np.testing.assert_array_equal(rows(row), VALUES[row])


def test_what_a_row_takes_counts(tmp_path: Path) -> None:
    file = NpzFile(written(tmp_path), VALUES[0].nbytes)
    with pytest.raises(PredictionError, match=r"a row of field 'depth': .* more than the limit"):
        RowStream(file, "depth", VALUES.shape)


def test_damage_is_found_where_it_is_read(tmp_path: Path) -> None:
    path = written(tmp_path)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    rows = RowStream(NpzFile(path, 1 << 20), "depth", VALUES.shape)
    np.testing.assert_array_equal(rows(0), VALUES[0])
    with pytest.raises(PredictionError, match="field 'depth' is damaged or cut off"):
        rows(6)
