"""What could give a wrong number in silence: refused, or exact."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import airzoo_bench as ab
from airzoo_bench.core.errors import ArgumentError
from tests.statistics.support import ERROR, HIT, random_methods, write_method

MASKED = np.ma.array([1.0, 0.0], mask=[True, False])
SQUARE = np.eye(3)


@pytest.mark.parametrize(
    ("ranked", "positives", "expected"),
    [
        ([[2**63 + 1], [5]], [[2**63 + 2], [5]], 0.5),
        ([[2**62 + 1], [2**62 + 9], [2**63]], [[2**62 + 2], [2**62 + 10], [2**63]], 1 / 3),
        ([np.array([2**63 + 1], np.uint64), np.array([-1])], [[2**63 + 1], [5]], 0.5),
    ],
)
def test_ids_of_64_bits_are_not_rounded(ranked: Any, positives: Any, expected: float) -> None:
    found = ab.retrieval_scores(ranked, positives, ks=(1,))
    assert found["recall@1"] == pytest.approx(expected)


@pytest.mark.parametrize(
    "call",
    [
        lambda: ab.recall_at_k([MASKED], k=1),
        lambda: ab.descriptor_scores(np.ma.array(SQUARE, mask=SQUARE > 0), SQUARE, [[0], [1], [2]]),
        lambda: ab.descriptor_scores(SQUARE, np.ma.array(SQUARE, mask=SQUARE > 0), [[0], [1], [2]]),
        lambda: ab.cloud_scores([np.ma.array([1.0, 2, 3], mask=[1, 0, 0])], SQUARE, threshold=1.0),
    ],
)
def test_masked_entries_are_refused(call: Any) -> None:
    with pytest.raises(ArgumentError, match="masked entries") as error:
        call()
    assert str(error.value).count("masked entries") == 1


@pytest.mark.parametrize("missing", [np.nan, None])
def test_a_scene_without_a_name_is_refused(missing: Any) -> None:
    with pytest.raises(ArgumentError, match="missing"):
        ab.bootstrap_ci([1] * 5 + [0] * 5, ["a"] * 5 + [missing] * 5, statistic="share")


def test_float32_clouds_of_projected_coordinates_are_refused() -> None:
    cloud = np.random.default_rng(0).random((100, 3)) * 20 + (5e5, 5e6, 0)
    with pytest.raises(ArgumentError, match="float32"):
        ab.cloud_scores(cloud.astype(np.float32), cloud, threshold=0.2)
    assert ab.cloud_scores(cloud.astype(np.float32), cloud, threshold=10.0).f1 == 1.0
    local = (cloud - (5e5, 5e6, 0)).astype(np.float32)
    assert ab.cloud_scores(local, local, threshold=0.2).f1 == 1.0


def test_limits_that_rounding_would_make_are_refused() -> None:
    with pytest.raises(ArgumentError, match="confidence"):
        ab.bootstrap_ci([1, 0, 1], statistic="share", confidence=1 - 1e-16)


def test_an_angle_beyond_a_half_turn_is_refused() -> None:
    with pytest.raises(ArgumentError, match="180"):
        ab.pose_scores(([1.0, 2.0], [400.0, 1.0]))
    assert ab.pose_scores(([1.0, 2.0], [np.inf, 180.0]))["within_5m_1deg"] == 0.0


@pytest.mark.parametrize("path", [None, 3, "a" * 5000, "a\0b"])
@pytest.mark.parametrize(
    "call",
    [
        ab.load_result,
        ab.load_benchmark,
        lambda path: ab.PredictionWriter(path, "airzoo-mini-retrieval"),
    ],
)
def test_what_is_no_path_is_refused(call: Any, path: Any, tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="path"):
        call(path)


RELEVANCES = [
    np.eye(3, dtype=int),
    np.eye(3).tolist(),
    np.eye(3, dtype=bool),
    pd.DataFrame(np.eye(3)),
]


@pytest.mark.parametrize("relevances", RELEVANCES)
@pytest.mark.parametrize(
    "call",
    [
        lambda rows: ab.similarity_scores(np.eye(3), rows),
        lambda rows: ab.descriptor_scores(np.eye(3), np.eye(3), rows),
        lambda rows: ab.retrieval_scores([[0, 1, 2]] * 3, rows),
    ],
)
def test_a_matrix_of_relevances_is_no_list_of_ids(call: Any, relevances: Any) -> None:
    with pytest.raises(ArgumentError, match=r"(?s)positives\[0\].*0 or 1.*np.flatnonzero"):
        call(relevances)


def test_grades_of_relevance_are_no_ids() -> None:
    with pytest.raises(ArgumentError, match=r"(?s)positives: .*np.flatnonzero"):
        ab.similarity_scores(np.eye(3), [[2, 0, 0], [0, 2, 1], [1, 0, 2]])
    found = ab.similarity_scores(np.eye(3), [{0, 1}, [1, 1], [2]], ks=(1,))
    assert found["recall@1"] == 1.0


CLOUD = pd.DataFrame(np.random.default_rng(0).random((50, 3)) * (100, 50, 5), columns=[*"xyz"])


def test_coordinates_are_taken_by_the_names_of_their_columns() -> None:
    turned = CLOUD[["z", "x", "y"]]
    assert ab.cloud_scores(turned, CLOUD, threshold=1.0).f1 == 1.0
    assert ab.cloud_scores(turned, CLOUD.to_numpy(), threshold=1.0).f1 == 1.0
    assert ab.align_cameras(turned, CLOUD).scale == pytest.approx(1.0)
    named = CLOUD.set_axis(["Easting", "Northing", "Height"], axis=1)
    assert ab.cloud_scores(named[["Northing", "Easting", "Height"]], CLOUD, threshold=1.0).f1 == 1.0


@pytest.mark.parametrize(
    "call",
    [
        lambda one, other: ab.cloud_scores(one, other, threshold=1.0),
        ab.align_cameras,
        lambda one, other: ab.descriptor_scores(one, other, [[i] for i in range(50)]),
        lambda one, other: ab.retrieval_scores(
            one, [[1]] * 50, scores=other, gallery_ids=range(3), ks=(1,)
        ),
    ],
)
def test_columns_in_another_order_are_refused(call: Any) -> None:
    table = CLOUD.set_axis(["a", "b", "c"], axis=1)
    with pytest.raises(ArgumentError, match="different columns"):
        call(table, table[["c", "a", "b"]])


def test_descriptors_of_other_columns_are_refused() -> None:
    positives = [[i] for i in range(50)]
    with pytest.raises(ArgumentError, match="queries, gallery: have different columns"):
        ab.descriptor_scores(CLOUD, CLOUD.set_axis([0, 1, 2], axis=1), positives)
    with pytest.raises(ArgumentError, match="queries, gallery: have different columns"):
        ab.descriptor_scores(CLOUD, CLOUD[["z", "y", "x"]], positives)
    assert ab.descriptor_scores(CLOUD, CLOUD.to_numpy(), positives, ks=(1,))["recall@1"] == 1.0


@pytest.mark.parametrize("labels", [["1", "10", "2"], ["rank_3", "rank_1", "rank_2"], [2, 1, 0]])
def test_ranks_in_another_order_are_refused(labels: list[Any]) -> None:
    table = pd.DataFrame([[1, 0, 0]], columns=labels)
    with pytest.raises(ArgumentError, match="hits: has the columns"):
        ab.recall_at_k(table, 1)
    with pytest.raises(ArgumentError, match="ranked_ids: has the columns"):
        ab.retrieval_scores(table, [[1]], ks=(1,))


def test_ids_of_64_bits_stand_next_to_small_ones() -> None:
    ranked = [[2**63 + 1, 5, 2**63 + 2]]
    found = ab.retrieval_scores(ranked, [[2**63 + 2]], ks=(1, 3))
    assert (found["recall@1"], found["mrr"]) == (0.0, pytest.approx(1 / 3))
    for ids in ([2**63 + 1, -1], [2**64, 5]):
        with pytest.raises(ArgumentError, match=r"(?s)holds whole numbers from.*str\(id\)"):
            ab.retrieval_scores([ids], [[5]], ks=(1,))


@pytest.mark.parametrize("results", [None, 3])
def test_nothing_that_can_be_compared_is_refused(results: Any) -> None:
    with pytest.raises(ArgumentError, match="results: is"):
        ab.compare(results)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [2.0**-40, 2.0**-150])
@pytest.mark.parametrize("statistic", ["mean", "median"])
def test_intervals_of_tiny_numbers_are_those_of_others(size: float, statistic: Any) -> None:
    values = np.random.default_rng(0).random(40).round(4)
    whole, tiny = (ab.bootstrap_ci(values * f, statistic=statistic) for f in (1.0, size))
    assert tiny.method == whole.method == "bca"
    assert [tiny.low, tiny.high] == pytest.approx([whole.low * size, whole.high * size], rel=1e-9)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [1e-100, 1e-160, 1e-200, 1e-310])
def test_cosines_of_tiny_descriptors_are_those_of_others(size: float) -> None:
    rng = np.random.default_rng(0)
    queries, gallery, positives = rng.normal(size=(5, 8)), rng.normal(size=(20, 8)), [[3]] * 5
    for one, other in ((1.0, size), (size, 1.0), (size, size)):
        found, expected = (
            ab.descriptor_scores(queries * a, gallery * b, positives, metric="cosine")["map"]
            for a, b in ((one, other), (1.0, 1.0))
        )
        assert found == expected


@pytest.mark.parametrize("strange", [3, {}, [None], b"x", float("nan"), 2**70, object()])
def test_what_is_no_name_is_refused(strange: Any, tmp_path: Path) -> None:
    made = random_methods(2, {"city": 40, "rural": 30}, [HIT, ERROR])
    paths = [write_method(tmp_path / one.name, one) for one in made]
    calls: dict[str, Callable[[], object]] = {
        "scores": lambda: ab.compare(paths, [strange]),
        "reference": lambda: ab.compare(paths, reference=strange),
        "method": lambda: ab.compare(paths, method=strange),
        "scene": lambda: ab.compare(paths, scene=strange),
        "protocol": lambda: ab.evaluate("x.npz", protocol=strange),
        "data": lambda: ab.check("x.npz", data=strange),
    }
    for name, call in calls.items():
        with pytest.raises(ArgumentError, match=rf"^{name}: is "):
            call()
    with pytest.raises(ArgumentError, match=r"^data: is "):
        ab.load_benchmark("airzoo-mini", data=strange)
