"""From a file to the retrieval track's prediction type."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.retrieval.predictions import (
    Descriptors,
    RankedIds,
    check_predictions,
    read_retrieval,
)

LIMIT = 1 << 24
IDS = np.array(["e/a", "e/b"])
RANKED = {"query_ids": IDS, "ranked_ids": np.array([["e/t1", "e/t2"], ["e/t2", ""]])}
SCORES = np.array([[2, 1], [3, np.nan]], np.float16)  # NaN beside an empty id is nobody's score
DESCRIBED = {
    "query_ids": np.char.encode(IDS, "utf-8"),
    "query_descriptors": np.eye(2),
    "gallery_ids": ["e/1", "e/2", "e/3"],
    "gallery_descriptors": np.asfortranarray(np.arange(6, dtype=">f4").reshape(3, 2)),
}


def saved(folder: Path, **arrays: Any) -> Path:
    np.savez(folder / "p.npz", **arrays)
    return folder / "p.npz"


def test_both_forms_of_npz_and_parquet(tmp_path: Path) -> None:
    scores = np.nan_to_num(SCORES.astype(float))  # tables have a number in every place
    table = {name: values.tolist() for name, values in (RANKED | {"scores": scores}).items()}
    pd.DataFrame(table).assign(protocol="p").to_parquet(tmp_path / "p.parquet")
    arrays = saved(tmp_path, protocol="p", scores=SCORES, **RANKED)
    for path, expected in ((arrays, SCORES), (tmp_path / "p.parquet", scores)):
        read = read_retrieval(path, LIMIT)
        assert isinstance(read.content, RankedIds)
        assert (read.protocol, read.query_ids.tolist()) == ("p", IDS.tolist())
        assert read.content.ids.tolist() == RANKED["ranked_ids"].tolist()
        np.testing.assert_array_equal(read.content.scores, expected)
        check_predictions(read)
    read = read_retrieval(saved(tmp_path, **DESCRIBED), LIMIT)
    assert isinstance(read.content, Descriptors)
    assert (read.protocol, read.query_ids.tolist()) == (None, IDS.tolist())
    np.testing.assert_array_equal(read.content.gallery, DESCRIBED["gallery_descriptors"])


@pytest.mark.parametrize("field", [*RANKED, *DESCRIBED])
@pytest.mark.parametrize("value", [np.array(1.5), np.zeros((2, 2, 2)), np.zeros(2, bool), b"x"])
def test_every_field_of_a_wrong_type(field: str, value: Any, tmp_path: Path) -> None:
    arrays = RANKED if field in RANKED else DESCRIBED
    with pytest.raises(PredictionError, match=f"field '{field}'"):
        read_retrieval(saved(tmp_path, **(arrays | {field: value})), LIMIT)
