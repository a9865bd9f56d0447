"""From a file to the retrieval track's prediction type."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.retrieval.checks import check_predictions
from airzoo_bench.retrieval.predictions import Descriptors, RankedIds, read_retrieval

LIMIT = 1 << 24
IDS = np.array(["e/a", "e/b"])
RANKED = np.array([["e/t1", "e/t2"], ["e/t2", ""]])


def saved(folder: Path, **arrays: Any) -> Path:
    np.savez(folder / "p.npz", **arrays)
    return folder / "p.npz"


def test_ranked_ids(tmp_path: Path) -> None:
    scores = np.array([[2, 1], [3, np.nan]], np.float16)
    path = saved(tmp_path, protocol="p", query_ids=IDS, ranked_ids=RANKED, scores=scores)
    read = read_retrieval(path, LIMIT)
    assert (read.protocol, read.content.kind, read.path) == ("p", "ranked_ids", path)
    assert isinstance(read.content, RankedIds)
    assert read.content.ids.tolist() == RANKED.tolist()
    assert read.content.scores is not None
    assert read.content.scores.dtype == np.float64
    # NaN beside an empty id is nobody's score.
    check_predictions(read)


def test_descriptors(tmp_path: Path) -> None:
    gallery = np.asfortranarray(np.arange(6, dtype=">f4").reshape(3, 2))
    path = saved(
        tmp_path,
        query_ids=np.char.encode(IDS, "utf-8"),
        query_descriptors=np.eye(2),
        gallery_ids=["e/1", "e/2", "e/3"],
        gallery_descriptors=gallery,
    )
    read = read_retrieval(path, LIMIT)
    assert (read.protocol, read.content.kind) == (None, "descriptors")
    assert isinstance(read.content, Descriptors)
    assert read.query_ids.tolist() == IDS.tolist()
    np.testing.assert_array_equal(read.content.gallery, gallery)


def test_npz_and_parquet_say_the_same(tmp_path: Path) -> None:
    scores = np.array([[2.0, 1.0], [3.0, 0.0]])
    columns = {
        "query_ids": IDS.tolist(),
        "ranked_ids": RANKED.tolist(),
        "scores": scores.tolist(),
        "protocol": ["p", "p"],
    }
    pd.DataFrame(columns).to_parquet(tmp_path / "p.parquet")
    one = read_retrieval(tmp_path / "p.parquet", LIMIT)
    other = read_retrieval(
        saved(tmp_path, protocol="p", query_ids=IDS, ranked_ids=RANKED, scores=scores), LIMIT
    )
    assert one.protocol == other.protocol == "p"
    assert one.query_ids.tolist() == other.query_ids.tolist()
    assert isinstance(one.content, RankedIds)
    assert isinstance(other.content, RankedIds)
    assert one.content.ids.tolist() == other.content.ids.tolist()
    assert one.content.scores is not None
    assert one.content.scores.tolist() == scores.tolist()


@pytest.mark.parametrize(
    "field", ["query_ids", "ranked_ids", "gallery_ids", "query_descriptors", "gallery_descriptors"]
)
@pytest.mark.parametrize("value", [np.array(1.5), np.zeros((2, 2, 2)), np.zeros(2, bool), b"x"])
def test_every_field_of_a_wrong_type(field: str, value: Any, tmp_path: Path) -> None:
    arrays: dict[str, Any] = {"query_ids": IDS, "ranked_ids": RANKED}
    if field not in arrays:
        arrays = {
            "query_ids": IDS,
            "query_descriptors": np.eye(2),
            "gallery_ids": IDS,
            "gallery_descriptors": np.eye(2),
        }
    with pytest.raises(PredictionError, match=f"field '{field}'") as caught:
        read_retrieval(saved(tmp_path, **(arrays | {field: value})), LIMIT)
    assert caught.value.expected
    assert caught.value.fix
