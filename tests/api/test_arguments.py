"""What could give a wrong number in silence is refused by name, in every function."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import airzoo_bench as ab
from airzoo_bench.core.errors import ResultError
from tests.api.support import refused
from tests.statistics.support import ERROR, HIT, random_methods, write_method

MASKED = np.ma.masked_array([[1.0, 0, 1], [0, 0, 1]], mask=[[1, 0, 0], [0, 0, 0]])
K = [[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]

# Each with the argument that the message names.
CALLS: dict[str, tuple[str, Callable[[], object]]] = {
    "a set of ids": ("ranked_ids[0]", lambda: ab.retrieval_scores([{"a", "b"}], [{"a"}], ks=(1,))),
    "a dict of scores": ("ranked_ids[0]", lambda: ab.retrieval_scores([{"a": 1.0}], [["a"]])),
    "a dict of relevances": ("positives[0]", lambda: ab.retrieval_scores([["a"]], [{"a": 1}])),
    "a set of hits": ("hits", lambda: ab.recall_at_k({1, 0}, 1)),
    "masked hits": ("hits", lambda: ab.recall_at_k(MASKED, 1)),
    "masked similarities": (
        "scores",
        lambda: ab.retrieval_scores(None, [[0], [1]], ks=(1,), scores=MASKED),
    ),
    "masked ids": (
        "ranked_ids[0]",
        lambda: ab.retrieval_scores([*MASKED.astype(int)], [{1}, {1}], ks=(1,)),
    ),
    "masked errors": ("errors[0]", lambda: ab.pose_scores((MASKED[0], None))),
    "a masked cloud": ("predicted", lambda: ab.cloud_scores(MASKED, np.eye(3), threshold=1)),
    "masked values": ("values", lambda: ab.bootstrap_ci(MASKED[0], statistic="share")),
    "masked fields": ("query_ids", lambda: ab.evaluate({"query_ids": MASKED}, protocol="x")),
    "ragged fields": (
        "ranked_ids",
        lambda: ab.evaluate({"ranked_ids": [["a"], ["a", "b"]]}, protocol="x"),
    ),
    "a large seed": ("seed", lambda: ab.bootstrap_ci([1.0, 0], statistic="share", seed=2**70)),
    "a large threshold": ("threshold", lambda: ab.cloud_scores(np.eye(3), np.eye(3), 1e300)),
    "huge centres": ("predicted", lambda: ab.align_cameras(np.eye(3) * 1e200, np.eye(3))),
    "huge values": ("values", lambda: ab.bootstrap_ci([1e200, 1, 2], statistic="mean")),
    "confidence of 1": (
        "confidence",
        lambda: ab.bootstrap_ci([1, 0, 1], statistic="share", confidence=1 - 1e-16),
    ),
    "beyond a half turn": ("errors[1]", lambda: ab.pose_scores(([1.0, 2.0], [400.0, 1.0]))),
    "a scene without a name": (
        "scenes",
        lambda: ab.bootstrap_ci([1] * 10, ["a"] * 9 + [None], statistic="share"),
    ),
}


@pytest.mark.parametrize("case", list(CALLS))
def test_what_has_no_order_or_hides_entries_or_is_out_of_range(case: str) -> None:
    where, call = CALLS[case]
    refused(call, where=where)


def test_masks_that_hide_nothing_are_taken() -> None:
    assert ab.recall_at_k(np.ma.masked_array([[1, 0], [0, 0]]), 1) == 0.5


LATER = pd.RangeIndex(10, 13)
POINTS = pd.DataFrame([[0.0, 0, 5], [4, 0, 5], [0, 3, 6]], LATER)
SERIES = pd.Series([1.0, 0.0, 1.0], LATER)
LISTS = pd.Series([["a", "b"], ["b", "a"], ["a", "b"]], LATER)
TRUTHS = pd.Series([{"a"}, {"b"}, {"a"}], LATER)
# Each with its first argument, and with the same rows of it in another order.
PAIRED: dict[str, tuple[Any, Callable[[Any], object]]] = {
    "ranked_ids, positives": (LISTS, lambda x: ab.retrieval_scores(x, TRUTHS, ks=(1,))),
    "hits, n_positives": (
        pd.DataFrame([[1, 0], [0, 1], [0, 0]], LATER),
        lambda x: ab.average_precision(x, pd.Series([1, 2, 3], LATER)),
    ),
    "predicted, true": (POINTS, lambda x: ab.align_cameras(x, POINTS, robust=False)),
    "errors[0], errors[1]": (SERIES, lambda x: ab.pose_scores((x, SERIES))),
    "pixels, points3d": (POINTS[[0, 1]], lambda x: ab.solve_pose(x, POINTS, K)),
    "values, scenes": (
        SERIES,
        lambda x: ab.bootstrap_ci(x, pd.Series([*"cdc"], LATER), statistic="share"),
    ),
}


@pytest.mark.parametrize("case", list(PAIRED))
def test_rows_of_pandas_are_not_paired_by_position_where_their_labels_differ(case: str) -> None:
    rows, call = PAIRED[case]
    assert str(call(rows.to_numpy())) == str(call(rows)), "one index, or the same, changes nothing"
    assert "index" in refused(call, rows[::-1], where=case)


def test_fields_of_predictions_have_one_index() -> None:
    fields = {
        "query_ids": pd.Series(["a", "b"]),
        "ranked_ids": pd.DataFrame([["t"], ["u"]], [1, 0]),
    }
    refused(ab.check, fields, protocol="x", where="query_ids, ranked_ids")


@pytest.mark.parametrize(
    ("ranked", "positives", "expected"),
    [
        ([[2**63 + 1], [5]], [[2**63 + 2], [5]], 0.5),
        ([[2**62 + 1], [2**62 + 9], [2**63]], [[2**62 + 2], [2**62 + 10], [2**63]], 1 / 3),
        ([np.array([2**63 + 1], np.uint64), np.array([-1])], [[2**63 + 1], [5]], 0.5),
        ([[2**63 + 1, 5]], [[5]], 0.0),
    ],
)
def test_ids_of_64_bits_are_not_rounded(ranked: Any, positives: Any, expected: float) -> None:
    assert ab.retrieval_scores(ranked, positives, ks=(1,))["recall@1"] == pytest.approx(expected)


@pytest.mark.parametrize(
    "relevances",
    [np.eye(3, dtype=int), np.eye(3).tolist(), pd.DataFrame(np.eye(3, dtype=int)), [[2, 0, 0]] * 3],
)
def test_a_matrix_of_relevances_is_no_list_of_ids(relevances: Any) -> None:
    refused(ab.retrieval_scores, [[0, 1, 2]] * 3, relevances, where="positives[0]")


def test_columns_of_similarities_are_not_taken_for_numbers_of_tiles() -> None:
    matrix = pd.DataFrame(np.eye(3), columns=[7, 8, 9])
    rank = ab.retrieval_scores
    refused(rank, None, [[0], [1], [2]], ks=(1,), scores=matrix, where="scores")
    wrong = {"scores": matrix, "gallery_ids": [9, 8, 7]}
    refused(rank, None, [[7], [8], [9]], ks=(1,), where="scores", **wrong)
    right = rank(None, [[7], [8], [9]], ks=(1,), scores=matrix, gallery_ids=matrix.columns)
    assert right["recall@1"] == 1.0


def test_float32_clouds_of_projected_coordinates_are_refused() -> None:
    cloud = np.random.default_rng(0).random((100, 3)) * 20 + (5e5, 5e6, 0)
    refused(ab.cloud_scores, cloud.astype(np.float32), cloud, threshold=0.2, where="predicted")
    assert ab.cloud_scores(cloud.astype(np.float32), cloud, threshold=10.0).f1 == 1.0
    local = (cloud - (5e5, 5e6, 0)).astype(np.float32)
    assert ab.cloud_scores(local, local, threshold=0.2).f1 == 1.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [2.0**-40, 2.0**-150])
@pytest.mark.parametrize("statistic", ["mean", "median"])
def test_intervals_of_tiny_numbers_are_those_of_others(size: float, statistic: Any) -> None:
    values = np.random.default_rng(0).random(40).round(4)
    whole, tiny = (ab.bootstrap_ci(values * f, statistic=statistic) for f in (1.0, size))
    assert tiny.method == whole.method == "bca"
    assert [tiny.low, tiny.high] == pytest.approx([whole.low * size, whole.high * size], rel=1e-9)


def test_records_that_were_edited_are_not_compared(tmp_path: Path) -> None:
    made = random_methods(2, {"city": 40, "rural": 30}, [HIT, ERROR])
    one, other = (ab.load_result(write_method(tmp_path / m.name, m)) for m in made)
    other.records[HIT.key] = 1.0
    with pytest.raises(ResultError, match="does not fit the result next to it"):
        ab.compare([one, other])
