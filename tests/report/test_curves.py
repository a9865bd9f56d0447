"""Curves of methods side by side: what they show, and how methods are told apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from airzoo_bench.cli.plot import parse_length
from airzoo_bench.core.errors import UsageError
from airzoo_bench.report import draw
from airzoo_bench.report.curves import error_shares, longest_list, recall_curve
from airzoo_bench.report.figures import (
    figure_bytes,
    save_figure,
    series_style,
)
from airzoo_bench.report.sheet import Sheet, check_room
from tests.report.made import (
    HOSTILE,
    reconstruction_method,
    retrieval_method,
    texts_of,
)
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


def test_styles_tell_28_methods_apart_and_markers_many_more() -> None:
    assert len({tuple(series_style(n).values()) for n in range(196)}) == 196
    lines = {(series_style(n)["color"], series_style(n)["linestyle"]) for n in range(28)}
    marks = {(series_style(n)["color"], series_style(n)["marker"]) for n in range(49)}
    assert (len(lines), len(marks)) == (28, 49)


def test_a_line_ends_where_the_longest_list_does() -> None:
    short, long = retrieval_method("short", 0), retrieval_method("long", 1)
    short.records["ranked"], long.records["ranked"] = 3, 4
    short.records.loc[0, "ranked"] = 1
    assert longest_list(short, 5) == 3
    figure = draw.recall([short, long])
    axes = figure.axes[0]
    lines = [line for line in axes.lines if line.get_linestyle() != "None"]
    assert [line.get_xdata()[-1] for line in lines] == [3, 4]
    assert axes.get_xlim()[1] < 5
    assert "lists end earlier: short at 3" in texts_of(figure)
    del short.records["ranked"]
    assert longest_list(short, 5) == 5


def test_a_method_without_any_list_still_has_a_mark() -> None:
    method = retrieval_method("a", 0)
    method.records["ranked"] = 0
    assert longest_list(method, 5) == 1
    figure_bytes(draw.recall([method]), "png")


def test_a_line_beneath_another_is_wider() -> None:
    methods = [retrieval_method(name, 0) for name in ("a", "b")]
    lines = [x for x in draw.recall(methods).axes[0].lines if x.get_linestyle() != "None"]
    assert lines[0].get_linewidth() > lines[1].get_linewidth()


def test_what_an_error_curve_leaves_out_is_counted() -> None:
    method = retrieval_method("a", 0)
    failed = int(np.isinf(method.records["error_m"]).sum())
    said = texts_of(draw.errors([method], ERROR))
    assert f"off the axis, of 40 queries: a {failed} infinite" in said
    method.records["error_m"] = 1.0
    assert "off the axis" not in texts_of(draw.errors([method], ERROR))


def test_of_many_methods_the_counts_are_a_range() -> None:
    said = texts_of(draw.errors([retrieval_method(f"m{n}", n) for n in range(8)], ERROR))
    assert "of each of 8 methods" in said
    assert "m3" not in said.split("off the axis")[1].split("\n")[0]


def test_the_height_asked_for_is_that_of_all_that_is_drawn() -> None:
    methods = [retrieval_method("a", 0)]
    sheet = Sheet(3.3, "Title", height_in=parse_length("5.08cm", "--height"))
    for figure in (draw.recall(methods, None, sheet), draw.scenes(methods, HIT, sheet)):
        assert figure.get_figheight() == pytest.approx(2.0)
        assert figure.axes[0].get_position().height > 0.2
    with pytest.raises(UsageError, match="--height: 1 inches leave no room") as caught:
        draw.recall(methods, None, Sheet(3.3, height_in=1.0))
    assert "--bare" in str(caught.value)
    with pytest.raises(UsageError, match=r"--height 0\.5in is too small"):
        parse_length("0.5in", "--height")


def test_panels_that_a_height_squeezes_to_nothing_are_refused() -> None:
    methods = [reconstruction_method("a", 0)]
    with pytest.raises(UsageError, match="too little"):
        check_room(draw.thresholds(methods, Sheet(3.3, height_in=1.9)))
    check_room(draw.thresholds(methods, Sheet(3.3, height_in=4)))


def marks_at(figure: Figure) -> dict[float, int]:
    """Return how many filled marks stand at each place."""
    marks = [x for x in figure.axes[0].lines if x.get_markeredgecolor() == "white"]
    places = [float(x) for line in marks for x in line.get_xdata()]
    return {x: places.count(x) for x in places}


def test_marks_stand_at_the_named_k_and_methods_that_agree_take_turns() -> None:
    methods = [retrieval_method(name, 0) for name in ("a", "b", "c")]
    figure = draw.recall(methods)
    assert marks_at(figure) == {1: 1, 2: 1, 3: 1, 5: 1}
    marked = [x for x in figure.axes[0].lines if x.get_markeredgecolor() == "white"]
    assert [len(line.get_xdata()) for line in marked] == [2, 1, 1]
    axes = figure.axes[0]
    assert all(line.get_transform() == axes.transData for line in axes.lines)
    apart = draw.recall([retrieval_method("a", 0), retrieval_method("b", 1)])
    assert max(marks_at(apart).values()) == 2


def test_a_method_without_a_turn_is_a_ring() -> None:
    methods = [retrieval_method(name, 0) for name in ("a", "b", "c")]
    lines = draw.recall(methods, 1).axes[0].lines
    rings = [x for x in lines if x.get_markerfacecolor() == "none" and len(x.get_xdata())]
    assert [float(ring.get_xdata()[0]) for ring in rings] == [1, 1]
    assert rings[0].get_markersize() < rings[1].get_markersize()


@pytest.mark.parametrize("form", ["png", "svg", "pdf"])
def test_pictures_are_the_same_bytes_twice(tmp_path: Path, form: str) -> None:
    methods = [retrieval_method(HOSTILE, 0), retrieval_method("_hidden", 1)]
    for name in ("a", "b"):
        save_figure(draw.recall(methods), tmp_path / f"{name}.{form}")
    first, second = (tmp_path / f"{name}.{form}" for name in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()
    assert len(first.read_bytes()) > 4000
