"""What has no order, or hides entries, is refused where order and entries count."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import airzoo_bench as ab
from airzoo_bench.core.errors import PredictionError, ResultError
from tests.statistics.support import ERROR, HIT, random_methods, write_method

MASKED = np.ma.masked_array([[1.0, 0, 1], [0, 0, 1]], mask=[[1, 0, 0], [0, 0, 0]])
CALLS = {
    "a set of ranked ids": lambda: ab.retrieval_scores([{"a", "b"}], [{"a"}], ks=(1,)),
    "a dict of scores": lambda: ab.retrieval_scores([{"a": 0.1, "b": 0.9}], [["b"]], ks=(1,)),
    "a dict of relevances": lambda: ab.retrieval_scores([["a", "b"]], [{"a": 0, "b": 1}], ks=(1,)),
    "a set of hits": lambda: ab.recall_at_k({1, 0}, 1),
    "masked hits": lambda: ab.recall_at_k(MASKED, 1),
    "masked similarities": lambda: ab.similarity_scores(MASKED, [[0], [1]], ks=(1,)),
    "masked ids": lambda: ab.retrieval_scores(MASKED.astype(int), [{1}, {1}], ks=(1,)),
    "masked errors": lambda: ab.pose_scores((MASKED[0], None)),
    "a masked cloud": lambda: ab.cloud_scores(MASKED, np.eye(3), threshold=1),
    "masked values": lambda: ab.bootstrap_ci(MASKED[0], statistic="share"),
    "masked fields": lambda: ab.evaluate({"query_ids": MASKED}, protocol="x"),
    "ragged fields": lambda: ab.evaluate({"ranked_ids": [["a"], ["a", "b"]]}, protocol="x"),
    "thresholds of one name": lambda: ab.pose_scores(([5.0], None), [(5, 1), (5.0000001, 1)]),
    "a seed too large": lambda: ab.bootstrap_ci([1.0, 0], statistic="share", seed=2**70),
    "a threshold too large": lambda: ab.cloud_scores(np.eye(3), np.eye(3), threshold=1e300),
    "no path": lambda: ab.evaluate(None, protocol="x"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("case", list(CALLS))
def test_it_is_refused(case: str) -> None:
    with pytest.raises(ab.ArgumentError):
        CALLS[case]()


def test_what_hides_nothing_is_taken() -> None:
    assert ab.recall_at_k(np.ma.masked_array([[1, 0], [0, 0]]), 1) == 0.5
    scores: Any = ab.retrieval_scores([["a", "b"]], [{"a"}], ks=(1,))
    assert scores["recall@1"] == 1.0


def test_records_that_were_edited_are_not_compared(tmp_path: Path) -> None:
    made = random_methods(2, {"city": 40, "rural": 30}, [HIT, ERROR])
    one, other = (ab.load_result(write_method(tmp_path / m.name, m)) for m in made)
    assert ab.compare([one, other]) is not None
    other.records[HIT.key] = 1.0
    with pytest.raises(ResultError, match="does not fit the result next to it"):
        ab.compare([one, other])


def test_descriptors_are_of_one_type(field: Any, tmp_path: Path) -> None:
    scene = field.scenes[0]
    first, second = (photo.id for photo in list(scene.queries())[:2])
    writer = ab.PredictionWriter(tmp_path / "p.npz", f"{field.name}-retrieval")
    writer.add(first, descriptor=np.ones(4, np.float32))
    with pytest.raises(PredictionError, match="is float64, and the first was float32"):
        writer.add(second, descriptor=np.ones(4))


LATER = pd.RangeIndex(10, 13)
POINTS = pd.DataFrame([[0.0, 0, 5], [4, 0, 5], [0, 3, 6]], LATER)
SERIES = pd.Series([1.0, 0.0, 1.0], LATER)
LISTS = pd.Series([["a", "b"], ["b", "a"], ["a", "b"]], LATER)
TRUTHS = pd.Series([{"a"}, {"b"}, {"a"}], LATER)
GALLERY = pd.DataFrame(np.eye(3), LATER)
K = [[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]
# Each with its first argument, and with the same rows of it in another order.
PAIRED = {
    "ranked_ids, positives": (LISTS, lambda x: ab.retrieval_scores(x, TRUTHS, ks=(1,))),
    "ranked_ids, scores": (
        LISTS,
        lambda x: ab.retrieval_scores(
            x,
            list(TRUTHS),
            ks=(1,),
            scores=pd.DataFrame([[2, 1]] * 3, LATER),
            gallery_ids=["a", "b"],
        ),
    ),
    "similarity, positives": (
        pd.DataFrame(np.eye(3), LATER),
        lambda x: ab.similarity_scores(x, pd.Series([[0], [1], [2]], LATER), ks=(1,)),
    ),
    "queries, positives": (
        GALLERY,
        lambda x: ab.descriptor_scores(x, np.eye(3), pd.Series([[0], [1], [2]], LATER), ks=(1,)),
    ),
    "gallery, gallery_ids": (
        GALLERY,
        lambda x: ab.descriptor_scores(
            np.eye(3), x, [["a"], ["b"], ["c"]], ks=(1,), gallery_ids=pd.Series([*"abc"], LATER)
        ),
    ),
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
    with pytest.raises(ab.ArgumentError, match="index") as refusal:
        call(rows[::-1])
    assert refusal.value.where == case


def test_columns_of_similarities_are_not_taken_for_numbers_of_tiles() -> None:
    matrix = pd.DataFrame(np.eye(3), columns=[7, 8, 9])
    with pytest.raises(ab.ArgumentError, match="column") as refusal:
        ab.similarity_scores(matrix, [[0], [1], [2]], ks=(1,))
    assert refusal.value.fix == "gallery_ids=similarity.columns"
    with pytest.raises(ab.ArgumentError, match="column"):
        ab.similarity_scores(matrix, [[7], [8], [9]], ks=(1,), gallery_ids=[9, 8, 7])
    found = ab.similarity_scores(matrix, [[7], [8], [9]], ks=(1,), gallery_ids=matrix.columns)
    assert found["recall@1"] == 1.0


def test_fields_of_predictions_have_one_index() -> None:
    ids = pd.Series(["city/a", "city/b"])
    ranked = pd.DataFrame([["t"], ["u"]], [1, 0])
    with pytest.raises(ab.ArgumentError, match="index") as refusal:
        ab.check({"query_ids": ids, "ranked_ids": ranked}, protocol="x")
    assert refusal.value.where == "query_ids, ranked_ids"


HUGE = np.random.default_rng(0).normal(0, 30, (10, 3)) * 1e200


@pytest.mark.parametrize("robust", [True, False])
def test_numbers_whose_squares_overflow_are_refused(robust: bool) -> None:
    for given in ((HUGE, HUGE), (HUGE / 1e200, HUGE), (HUGE, HUGE / 1e200)):
        with pytest.raises(ab.ArgumentError, match="beyond"):
            ab.align_cameras(*given, robust=robust)
    with pytest.raises(ab.ArgumentError, match="beyond"):
        ab.bootstrap_ci(HUGE[:, 0], statistic="mean")
