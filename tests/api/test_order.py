"""What has no order, or hides entries, is refused where order and entries count."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
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
    with pytest.raises(ResultError, match="does not fit the result beside it"):
        ab.compare([one, other])


def test_descriptors_are_of_one_type(field: Any, tmp_path: Path) -> None:
    scene = field.scenes[0]
    first, second = (photo.id for photo in list(scene.queries())[:2])
    writer = ab.PredictionWriter(tmp_path / "p.npz", f"{field.name}-retrieval")
    writer.add(first, descriptor=np.ones(4, np.float32))
    with pytest.raises(PredictionError, match="is float64, and the first was float32"):
        writer.add(second, descriptor=np.ones(4))
