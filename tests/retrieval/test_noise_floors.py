"""Noise floors: which methods they leave apart, and the verdicts that they change."""

from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.results.comparison import compare
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.sensitivity import NoiseFloor, Sensitivity
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.verdicts import sentence, verdict
from tests.statistics.support import made_method

R1 = ScoreColumn(
    key="recall@1", title="R@1", unit="share", higher_is_better=True, average="mean", headline=True
)


def test_floors_and_ranks_of_three_methods_by_hand() -> None:
    base = np.array([[[0.5], [0.4], [0.4]]])
    values = np.array([[[[0.5], [0.4], [0.4]]], [[[0.4], [0.45], [0.4]]], [[[0.6], [0.5], [0.3]]]])
    found = Sensitivity(
        ("a", "b", "c"), (R1,), ("height_m",) * 3, ("s",), base, values, np.zeros((3, 1), int)
    )
    # Changes are (0, 0, 0), (-0.1, 0.05, 0), (0.1, 0.1, -0.1): b - c moves most, by 0.2.
    assert found.floors() == pytest.approx([0.2])
    assert found.floors("s") == pytest.approx([0.2])
    here, best, worst = found.ranks()
    assert here[:, 0].tolist() == [1, 2, 2]
    assert best[:, 0].tolist() == [1, 1, 2]
    assert worst[:, 0].tolist() == [2, 2, 3]


def noise_of(floor: float) -> NoiseFloor:
    """Return the noise of Recall@1 of two methods."""
    return NoiseFloor(
        protocol="p",
        protocol_fingerprint="",
        truth_fingerprint="",
        ranges={},
        draws=0,
        seed=0,
        methods={"sure": "0", "worse": "1"},
        overall={"recall@1": floor},
        scenes={},
    )


@pytest.mark.parametrize(("floor", "word"), [(0.3, "in noise"), (0.2, "in noise"), (0.19, "worse")])
def test_verdicts_by_floor(floor: float, word: str) -> None:
    sure = made_method({"s": {"recall@1": [1.0] * 100}}, name="sure")
    worse = made_method({"s": {"recall@1": [1.0] * 80 + [0.0] * 20}}, name="worse")
    plan = ResamplingConfig(resamples=1_000)
    (pair,) = compare([sure, worse], [R1], resampling=plan, noise_floor=noise_of(floor)).pairs
    assert verdict(pair) == word
    said = {"in noise": "noise floor of", "worse": "sure is better than worse"}
    assert said[word] in sentence(pair, plan)


@pytest.mark.parametrize(
    ("values", "word"),
    [([1.0] * 80 + [0.0] * 20, "cannot be told apart"), ([1.0] * 99 + [0.0], "Too few")],
)
def test_what_is_no_finding_may_be_in_noise_too(values: list[float], word: str) -> None:
    base = [1.0] * 82 + [0.0] * 18 if len(set(values[:99])) > 1 else [1.0] * 100
    sure = made_method({"s": {"recall@1": base}}, name="sure")
    worse = made_method({"s": {"recall@1": values[::-1]}}, name="worse")
    plan = ResamplingConfig(resamples=1_000)
    (pair,) = compare([sure, worse], [R1], resampling=plan, noise_floor=noise_of(0.05)).pairs
    said = sentence(pair, plan)
    assert word in said
    assert "no more than the benchmark's noise floor of 5.00" in said
    (pair,) = compare([sure, worse], [R1], resampling=plan).pairs
    assert "noise floor" not in sentence(pair, plan)
