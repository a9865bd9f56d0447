"""Pictures of methods side by side: what they show, how they are written, and hostile names."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.errors import UsageError
from airzoo_bench.report import draw
from airzoo_bench.report.curves import draw_by_condition, error_shares, recall_curve
from airzoo_bench.report.figures import label_text, save_figure, series_style
from airzoo_bench.report.overview import draw_heat_map, draw_intervals
from tests.report.made import HOSTILE, reconstruction_method, retrieval_method, run, write_methods
from tests.statistics.support import ERROR, HIT


def test_recall_is_the_mean_over_scenes() -> None:
    method = retrieval_method("a", 0, queries=6)
    records = pd.DataFrame(
        {"scene": ["a", "a", "a", "a", "b", "b"], "first_hit_rank": [1, 2, 2, 0, 3, 1]}
    )
    curve = recall_curve(method.__class__("a", method.result, records), 4)
    np.testing.assert_allclose(curve, [(1 / 4 + 1 / 2) / 2, (3 / 4 + 1 / 2) / 2, 7 / 8, 7 / 8])


def test_recall_curve_goes_through_the_recall_of_the_result() -> None:
    method = retrieval_method("a", 3)
    assert recall_curve(method, 5)[0] == pytest.approx(method.result.overall["recall@1"])


def test_errors_are_strictly_below_and_failures_never() -> None:
    method = retrieval_method("a", 0)
    records = pd.DataFrame({"scene": ["a", "a", "b", "b"], "error_m": [1.0, np.inf, 1.0, 3.0]})
    made = method.__class__("a", method.result, records)
    shares = error_shares(made, "error_m", np.array([1.0, 1.1, 3.0, 3.1, 1e9]))
    np.testing.assert_allclose(shares, [0, 0.5, 0.5, 0.75, 0.75])


def test_styles_tell_28_methods_apart() -> None:
    assert len({tuple(series_style(n).values()) for n in range(28)}) == 28


def test_intervals_stand_in_order_and_in_percent() -> None:
    limits = np.array([[0.1, 0.3], [np.nan, np.nan], [0.4, 0.6]])
    figure = draw_intervals(["a", "b", "c"], np.array([0.2, 0.9, 0.5]), limits, HIT, "")
    axes = figure.axes[0]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["a", "c", "b"]
    bars = [line.get_xdata().tolist() for line in axes.lines if line.get_linewidth() > 2]
    np.testing.assert_allclose(bars, [[10, 30], [40, 60]])


def test_of_errors_the_least_is_on_top_and_an_infinite_one_says_so() -> None:
    none = np.full((2, 2), np.nan)
    figure = draw_intervals(["a", "b"], np.array([np.inf, 2.0]), none, ERROR, "")
    labels = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert labels == ["a", "b"]
    assert [text.get_text() for text in figure.axes[0].texts] == ["infinite"]


def test_a_brighter_cell_is_better() -> None:
    values = np.array([[1.0, 9.0], [5.0, np.inf]])
    image = draw_heat_map(["a", "b"], ["x", "y"], values, ERROR).axes[0].images[0]
    np.testing.assert_allclose(image.get_array(), [[1, 0], [0.5, 0]])
    image = draw_heat_map(["a"], ["x", "y"], np.array([[0.2, 0.7]]), HIT).axes[0].images[0]
    np.testing.assert_allclose(image.get_array(), [[0, 1]])


def test_a_condition_shows_counts_and_leaves_out_what_is_infinite() -> None:
    values = np.array([[0.5, np.inf]])
    figure = draw_by_condition(["a"], values, ["low", "high"], [3, 4], HIT, "altitude [m]")
    axes = figure.axes[0]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["low\nn = 3", "high\nn = 4"]
    assert axes.get_ylabel() == "R@1 [%]"
    points = next(line for line in axes.lines if line.get_label() == "a").get_ydata()
    np.testing.assert_allclose(points, [50, np.nan])


@pytest.mark.parametrize("form", ["png", "svg", "pdf"])
def test_pictures_are_the_same_bytes_twice(tmp_path: Path, form: str) -> None:
    methods = [retrieval_method(HOSTILE, 0), retrieval_method("_hidden", 1)]
    for name in ("a", "b"):
        save_figure(draw.recall(methods), tmp_path / f"{name}.{form}")
    first, second = (tmp_path / f"{name}.{form}" for name in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()
    assert len(first.read_bytes()) > 4000


def test_hostile_names_are_text(tmp_path: Path) -> None:
    methods = [
        retrieval_method(HOSTILE, 0),
        retrieval_method("_hidden", 1),
        retrieval_method("数", 2),
    ]
    save_figure(draw.recall(methods), tmp_path / "a.svg")
    root = ET.parse(tmp_path / "a.svg").getroot()
    texts = {"".join(node.itertext()) for node in root.iter("{http://www.w3.org/2000/svg}text")}
    assert {"_hidden", "数", label_text(HOSTILE).replace(r"\$", "$")} <= texts
    assert not list(root.iter("{http://www.w3.org/2000/svg}script"))


def test_dollars_are_no_formula() -> None:
    assert label_text("$x$ \n y") == r"\$x\$ y"
    assert len(label_text("a" * 500)) < 60


@pytest.mark.parametrize(
    "ask",
    [
        ("recall",),
        ("recall", "--up-to", 3),
        ("errors",),
        ("intervals", "--score", "R@1"),
        ("scenes",),
        ("condition", "--by", "weather"),
        ("condition", "--by", "altitude_m", "--bins", "50,100"),
    ],
)
def test_every_kind_is_drawn(tmp_path: Path, ask: tuple[object, ...]) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 0), retrieval_method("b", 1)])
    done = run("plot", ask[0], *paths, *ask[1:], "-o", tmp_path / "x.svg")
    assert done.exit_code == 0, done.output
    assert "<svg" in (tmp_path / "x.svg").read_text()


def test_thresholds_are_of_reconstruction(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [reconstruction_method("a", 0), reconstruction_method("b", 1)])
    done = run("plot", "thresholds", *paths, "-o", tmp_path / "x.png")
    assert done.exit_code == 0, done.output
    methods = [reconstruction_method("a", 0)]
    panels = draw.thresholds(methods).axes
    overall = methods[0].result.overall
    np.testing.assert_allclose(
        [axes.lines[0].get_ydata() for axes in panels],
        [[100 * overall[f"{w}_{d}m"] for d in (1, 10)] for w in ("precision", "recall", "f1")],
    )


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (("thresholds", "-o", "x.png"), "no precision over distance"),
        (("recall", "-o", "x.gif"), "cannot be written as .gif"),
        (("recall", "--up-to", 9, "-o", "x.png"), "keeps 5 ranks"),
        (("condition", "-o", "x.png"), "--by"),
        (("recall", "--by", "weather", "-o", "x.png"), "--by"),
        (("errors", "--score", "R@1", "-o", "x.png"), "no error"),
    ],
)
def test_what_cannot_be_drawn(tmp_path: Path, ask: tuple[object, ...], said: str) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("a", 0)])
    where = [tmp_path / a if str(a).startswith("x.") else a for a in ask]
    done = run("plot", where[0], path, *where[1:])
    assert isinstance(done.exception, UsageError)
    assert said in str(done.exception)
    assert not list(tmp_path.glob("x.*"))


def test_ranks_are_of_retrieval(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [reconstruction_method("a", 0)])
    done = run("plot", "recall", path, "-o", tmp_path / "x.png")
    assert "no ranks" in str(done.exception)
