"""Pictures of methods side by side: what they show, what is said around them, the same bytes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from airzoo_bench.core.errors import UserError
from airzoo_bench.report import draw
from airzoo_bench.report.figures import (
    Sheet,
    axis_label,
    error_colours,
    figure_bytes,
    label_text,
    save_figure,
    series_style,
)
from airzoo_bench.report.plots import (
    draw_intervals,
    error_shares,
    longest_list,
    recall_curve,
    share_below,
)
from airzoo_bench.results.records import Scored
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import breakdown_table
from tests.report.made import HOSTILE, reconstruction_method, retrieval_method, texts_of
from tests.statistics.support import CHAMFER, ERROR, HIT, made_result

INF, NAN = np.inf, np.nan


def test_recall_is_the_mean_over_scenes() -> None:
    method = retrieval_method("a", 0, queries=6)
    records = pd.DataFrame(
        {"scene": ["a", "a", "a", "a", "b", "b"], "first_hit_rank": [1, 2, 2, 0, 3, 1]}
    )
    curve = recall_curve(Scored("a", method.result, records), 4)
    np.testing.assert_allclose(curve, [(1 / 4 + 1 / 2) / 2, (3 / 4 + 1 / 2) / 2, 7 / 8, 7 / 8])
    whole = retrieval_method("a", 3)
    assert recall_curve(whole, 5)[0] == pytest.approx(whole.result.overall["recall@1"])


def test_errors_are_strictly_below_and_failures_never() -> None:
    method = retrieval_method("a", 0)
    records = pd.DataFrame({"scene": ["a", "a", "b", "b"], "error_m": [1.0, INF, 1.0, 3.0]})
    limits = np.array([1.0, 1.1, 3.0, 3.1, 1e9])
    shares = error_shares(Scored("a", method.result, records), "error_m", limits)
    np.testing.assert_allclose(shares, [0, 0.5, 0.5, 0.75, 0.75])
    assert share_below(np.array([5.0, 5.0, 1.0]), np.array([5.0])) == pytest.approx(1 / 3)


def test_styles_tell_many_methods_apart() -> None:
    assert len({tuple(series_style(n).values()) for n in range(196)}) == 196
    lines = {(series_style(n)["color"], series_style(n)["linestyle"]) for n in range(28)}
    assert len(lines) == 28


def test_a_line_ends_where_the_longest_list_does() -> None:
    short, long = retrieval_method("short", 0), retrieval_method("long", 1)
    short.records["ranked"], long.records["ranked"] = 3, 4
    short.records.loc[0, "ranked"] = 1
    assert longest_list(short, 5) == 3
    figure = draw.recall([short, long])
    assert [line.get_xdata()[-1] for line in figure.axes[0].lines] == [3, 4]
    assert "lists end earlier: short at 3" in texts_of(figure)
    short.records["ranked"] = 0
    figure_bytes(draw.recall([short]), "png")


def marks_of(axes: Axes) -> list[tuple[float, float, str]]:
    """Return the places of round marks, and how they are filled."""
    return [
        (float(line.get_xdata()[0]), float(line.get_ydata()[0]), line.get_markerfacecolor())
        for line in axes.lines
        if line.get_marker() == "o"
    ]


def of_values(name: str, values: list[float]) -> Scored:
    records = pd.DataFrame({"scene": "s", "query": ["x"], "error_m": values})
    return Scored(name, made_result(records, (ERROR,), name), records)


def test_intervals_stand_in_order_and_infinite_ones_on_the_edge() -> None:
    methods = [of_values("a", [INF]), of_values("b", [2.0]), of_values("c", [3.0])]
    limits = np.array([[3.0, INF], [1.0, 4.0], [NAN, NAN]])
    axes = draw_intervals(methods, ERROR, limits, Sheet()).axes[0]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["a", "c", "b"]
    assert [mark[:2] for mark in marks_of(axes)] == [(1, 0), (3, 1), (2, 2)]
    assert [mark[2] == "white" for mark in marks_of(axes)] == [True, False, False]
    bars = [np.asarray(x.get_xdata()).tolist() for x in axes.lines if x.get_linewidth() > 2]
    assert bars == [[1, 4]]
    [arrow] = axes.texts
    assert arrow.xyann == (3.0, 0)


def test_a_brighter_cell_is_better_and_infinite_ones_are_grey() -> None:
    methods = [of_values("a", [9.0]), of_values("b", [1.0]), of_values("c", [INF])]
    figure = draw.scenes(methods, ERROR)
    axes = figure.axes[0]
    image = axes.images[0]
    light = image.to_rgba(np.ma.getdata(image.get_array()))[:2, 0, :3].sum(axis=1)
    assert light.argmax() == 1
    assert np.ma.getmaskarray(image.get_array()).ravel().tolist() == [False, False, True]
    assert [text.get_text() for text in axes.texts] == ["9.00", "1.00", "inf"]
    assert "grey: infinite" in texts_of(figure)


def test_a_condition_shows_counts_averages_and_the_intervals_of_breakdown() -> None:
    method = retrieval_method("a", 0)
    axes = draw.condition([method], HIT, "weather").axes[0]
    table = breakdown_table([method], [HIT], "weather", resampling=ResamplingConfig())
    ticks = [text.get_text() for text in axes.get_xticklabels()]
    rows = [(row.cells[0].value, row.cells[1].value) for row in table.rows]
    assert ticks == [f"{label} (n = {count})" for label, count in rows]
    found = [np.asarray(x.get_ydata()) for x in axes.lines if x.get_linewidth() == 0.9]
    spans = [row.cells[-1].uncertainty for row in table.rows]
    np.testing.assert_allclose(found, [[span.low, span.high] for span in spans if span])
    values = [row.cells[-1].value for row in table.rows]
    np.testing.assert_allclose([mark[1] for mark in marks_of(axes)], np.array(values, float))


def test_thresholds_are_those_of_the_protocol() -> None:
    methods = [reconstruction_method("a", 0)]
    settings = {"scores": {"headline_below_m": 10.0}}
    used = methods[0].result.protocol.model_copy(update={"settings": settings})
    result = methods[0].result.model_copy(update={"protocol": used})
    figure = draw.thresholds([Scored("a", result, methods[0].records)])
    assert "d = 10 m, of the headline" in texts_of(figure)
    overall = result.overall
    np.testing.assert_allclose(
        [axes.lines[0].get_ydata() for axes in figure.axes],
        [[100 * overall[f"{w}_{d}m"] for d in (1, 10)] for w in ("precision", "recall", "f1")],
    )


def every_kind(sheet: Sheet | None = None) -> list[Figure]:
    methods = [retrieval_method("a", 0), retrieval_method("b", 1)]
    return [
        draw.recall(methods, None, sheet),
        draw.errors(methods, ERROR, sheet),
        draw.intervals(methods, HIT, sheet),
        draw.scenes(methods, ERROR, sheet),
        draw.condition(methods, ERROR, "weather", None, sheet),
        draw.thresholds([reconstruction_method("a", 0)], sheet),
    ]


def test_pictures_say_what_they_are_of_in_letters_that_can_be_read() -> None:
    for figure in every_kind(Sheet(3.3)):
        assert "benchmark made, version 1; protocol" in texts_of(figure)
        assert figure.get_figwidth() == 3.3
        figure.draw_without_rendering()
        texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
        assert min(text.get_fontsize() for text in texts) >= 6
    assert axis_label(ERROR) == "median translation error [m]"
    assert axis_label(CHAMFER) == "Chamfer distance [m]"
    assert axis_label(HIT) == "R@1 [%]"


def test_one_scene_as_if_it_were_all() -> None:
    methods = [retrieval_method("a", 0), retrieval_method("b", 1)]
    east = draw.restrict_to_scene(methods, "east")
    ranks = methods[0].records.loc[methods[0].records["scene"] == "east", "first_hit_rank"]
    figure = draw.recall(east)
    assert figure.axes[0].lines[0].get_ydata()[0] == pytest.approx(100 * (ranks == 1).mean())
    assert "mean over scenes" not in figure.axes[0].get_ylabel()
    assert "20 queries in scene East" in texts_of(figure)
    with pytest.raises(UserError, match="no scene 'eats'"):
        draw.restrict_to_scene(methods, "eats")


@pytest.mark.parametrize("form", ["png", "svg", "pdf"])
def test_pictures_are_the_same_bytes_twice(tmp_path: Path, form: str) -> None:
    methods = [retrieval_method(HOSTILE, 0), retrieval_method("_hidden", 1)]
    for name in ("a", "b"):
        save_figure(draw.recall(methods), tmp_path / f"{name}.{form}")
    first, second = (tmp_path / f"{name}.{form}" for name in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()
    assert len(first.read_bytes()) > 4000


def test_hostile_names_are_text(tmp_path: Path) -> None:
    names = [HOSTILE, "_hidden", "数"]
    methods = [retrieval_method(name, number) for number, name in enumerate(names)]
    save_figure(draw.recall(methods), tmp_path / "a.svg")
    root = ET.parse(tmp_path / "a.svg").getroot()
    texts = {"".join(node.itertext()) for node in root.iter("{http://www.w3.org/2000/svg}text")}
    assert {"_hidden", "数", label_text(HOSTILE).replace(r"\$", "$")} <= texts
    assert not list(root.iter("{http://www.w3.org/2000/svg}script"))
    assert label_text("$x$ \n y") == r"\$x\$ y"


@pytest.mark.parametrize("limit", [0.1, 0.3, 10.0])
def test_no_error_below_the_limit_has_the_colour_of_those_beyond(limit: float) -> None:
    errors = np.append(np.linspace(0.0, 2 * limit, 4001), [np.nextafter(limit, 0.0), INF])
    beyond = (error_colours(errors, limit) == (213, 94, 0)).all(axis=1)
    np.testing.assert_array_equal(beyond, errors >= limit)
    light = error_colours(np.array([0.0, 0.5 * limit, 0.99 * limit]), limit).sum(axis=1)
    assert (np.diff(light.astype(int)) > 0).all()
