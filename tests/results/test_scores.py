"""How records become one number a scene and one for the benchmark."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.results.scores import Score, summarise

HIT = Score("recall@1", "R@1", "share", True, "mean")
ERROR = Score("error_m", "Median", "m", False, "median")


def records(east: list[float], west: list[float]) -> pd.DataFrame:
    scenes = ["east"] * len(east) + ["west"] * len(west)
    return pd.DataFrame({"scene": scenes, "recall@1": east + west, "error_m": east + west})


def test_by_hand() -> None:
    found = summarise(records([1, 0, 0, 0], [1.0]), [HIT, ERROR], ["west", "east"])
    assert list(found.scenes) == ["west", "east"]
    assert found.scenes["east"] == {"recall@1": 0.25, "error_m": 0.0}
    assert found.scenes["west"] == {"recall@1": 1.0, "error_m": 1.0}
    # Scenes count alike, of medians too; pooled, rows do.
    assert found.overall == {"recall@1": 0.625, "error_m": 0.5}
    assert found.pooled == {"recall@1": 0.4, "error_m": 0.0}


def test_medians_keep_failures() -> None:
    found = summarise(records([1, 2, np.inf], [np.inf]), [ERROR], ["east"])
    assert found.scenes == {"east": {"error_m": 2.0}}
    assert found.pooled == {"error_m": np.inf}


def test_numbers_of_any_kind_are_averaged_as_doubles() -> None:
    found = summarise(records([True, False, False], []), [HIT, ERROR], ["east"])
    assert found.overall == {"recall@1": 1 / 3, "error_m": 0.0}
    # Sums of single precision would lose half of the digits.
    single = np.array([0.1, 0.2, 0.4, 7.0], np.float32)
    columns = pd.DataFrame({"scene": "s", "recall@1": single})
    exact = sum(single.tolist()) / 4
    assert summarise(columns, [HIT], ["s"]).overall["recall@1"] == pytest.approx(exact, rel=1e-15)


@pytest.mark.parametrize(
    ("east", "message"),
    [
        ([1.0, np.nan], "recall@1: no record, or NaN, in 2 rows"),
        ([], "recall@1: no record, or NaN, in 0 rows"),
    ],
)
def test_a_scene_without_records_and_nan_are_bugs(east: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        summarise(records(east, [1.0]), [HIT], ["east", "west"])
