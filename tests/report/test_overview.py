"""Pictures of marks: intervals, heat map, conditions; and what is infinite in each."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from airzoo_bench.report import draw
from airzoo_bench.report.by_condition import draw_by_condition
from airzoo_bench.report.figures import figure_bytes
from airzoo_bench.report.overview import draw_heat_map, draw_intervals
from airzoo_bench.report.sheet import Sheet, check_room
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import breakdown_table
from tests.report.made import HOSTILE, reconstruction_method, retrieval_method
from tests.statistics.support import ERROR, HIT

INF, NAN = np.inf, np.nan


def texts_of(figure: Figure) -> str:
    return "\n".join(text.get_text() for text in figure.texts)


def marks_of(axes: Axes) -> list[tuple[float, float]]:
    """Return the places of filled and open round marks."""
    found = []
    for line in axes.lines:
        if line.get_marker() == "o":
            found += list(zip(line.get_xdata(), line.get_ydata(), strict=True))
    return [(float(x), float(y)) for x, y in found]


def test_intervals_stand_in_order_and_in_percent() -> None:
    limits = np.array([[0.1, 0.3], [NAN, NAN], [0.4, 0.6]])
    figure = draw_intervals(["a", "b", "c"], np.array([0.2, 0.9, 0.5]), limits, HIT, "")
    axes = figure.axes[0]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["a", "c", "b"]
    bars = [np.asarray(x.get_xdata()) for x in axes.lines if x.get_linewidth() > 2]
    np.testing.assert_allclose(bars, [[10, 30], [40, 60]])


def test_an_infinite_value_is_an_open_mark_beyond_a_break() -> None:
    limits = np.array([[3.0, INF], [1.0, 4.0]])
    figure = draw_intervals(["a", "b"], np.array([INF, 2.0]), limits, ERROR, "")
    axes, band = figure.axes
    assert [text.get_text() for text in axes.get_yticklabels()] == ["a", "b"]
    assert [text.get_text() for text in band.get_xticklabels()] == ["infinite"]
    assert marks_of(axes) == [(2.0, 1.0)]
    assert marks_of(band) == [(0.0, 0.0)]
    assert next(x for x in band.lines if x.get_marker() == "o").get_markerfacecolor() == "white"
    [arrow] = axes.texts
    assert arrow.xyann == (3.0, 0)
    assert axes.get_xlim()[1] > 4


def test_intervals_over_decades_go_by_powers_of_ten() -> None:
    limits = np.array([[0.4, 0.6], [90.0, 120.0]])
    axes = draw_intervals(["a", "b"], np.array([0.5, 100.0]), limits, ERROR, "").axes[0]
    assert axes.get_xscale() == "log"


def test_a_picture_without_intervals_says_why() -> None:
    said = texts_of(draw.intervals([reconstruction_method("a", 0)], HIT_OF_RECONSTRUCTION))
    assert "no interval: only 3 scenes" in said
    assert "bars" not in said
    assert "bars: 95 % interval, MOVER over queries within scenes" in texts_of(
        draw.intervals([retrieval_method("a", 0)], HIT)
    )


def test_who_has_no_interval_is_named() -> None:
    full, other = retrieval_method("full", 0), retrieval_method("other", 1)
    full.records["error_m"] = 1.0
    said = texts_of(draw.intervals([full, other], ERROR))
    assert "no interval of full: all queries are alike" in said


def test_a_brighter_cell_is_better() -> None:
    for score, factor, best in ((ERROR, 1, 0), (HIT, 100, 1)):
        values = np.array([[0.2, 0.9]])
        image = draw_heat_map(["a"], ["x", "y"], values, score).axes[0].images[0]
        np.testing.assert_allclose(np.ma.getdata(image.get_array()), factor * values)
        light = image.to_rgba(factor * values)[0, :, :3].sum(axis=1)
        assert light.argmax() == best


def test_infinite_cells_are_hatched_and_colours_are_of_the_others() -> None:
    values = np.array([[1.0, 9.0], [5.0, INF]])
    figure = draw_heat_map(["a", "b"], ["x", "y"], values, ERROR)
    axes, bar = figure.axes
    [cell] = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    assert (cell.get_xy(), cell.get_hatch()) == ((0.5, 0.5), "////")
    assert axes.images[0].get_clim() == (1, 9)
    assert [text.get_text() for text in axes.texts] == ["1.00", "9.00", "5.00", "inf"]
    assert "translation" in bar.get_ylabel()
    assert "[m] ↓" in bar.get_ylabel().replace("\n", " ")
    assert "hatched: infinite" in texts_of(figure)


def test_a_condition_shows_counts_and_its_infinite_values_above() -> None:
    values = np.array([[0.5, INF, 7.0]])
    labels = ["low", "mid", "high"]
    figure = draw_by_condition(["a"], values, labels, [3, 4, 5], ERROR, "altitude [m]")
    axes, band = figure.axes
    ticks = [text.get_text() for text in axes.get_xticklabels()]
    assert ticks == ["low\nn = 3", "mid\nn = 4", "high\nn = 5"]
    assert axes.get_ylabel() == "median translation error [m]"
    points = next(line for line in axes.lines if line.get_label() == "a").get_ydata()
    np.testing.assert_allclose(np.asarray(points, float), [0.5, NAN, 7.0])
    assert marks_of(band) == [(1.0, 0.0)]
    assert [text.get_text() for text in band.get_yticklabels()] == ["infinite"]


def test_whiskers_are_the_intervals_of_breakdown() -> None:
    method = retrieval_method("a", 0)
    axes = draw.condition([method], HIT, "weather").axes[0]
    found = [np.asarray(x.get_ydata()) for x in axes.lines if x.get_linewidth() == 0.9]
    table = breakdown_table([method], [HIT], "weather", resampling=ResamplingConfig())
    spans = [row.cells[-1].uncertainty for row in table.rows]
    wanted = [[span.low, span.high] for span in spans]
    np.testing.assert_allclose(found, np.array(wanted, float))


def test_an_infinite_limit_is_an_arrow_to_the_edge() -> None:
    limits = np.array([[[1.0, INF], [1.0, 3.0]]])
    values = np.array([[2.0, 2.0]])
    axes = draw_by_condition(["a"], values, ["x", "y"], [9, 9], ERROR, "", limits).axes[0]
    [arrow] = axes.texts
    assert arrow.xyann == (0.0, 1.0)
    assert arrow.xy == (0.0, 1.0)  # of the axes: the upper edge


@pytest.mark.slow
def test_many_hostile_long_and_narrow() -> None:
    names = [HOSTILE, "_x", *(f"a method with a name of its own, {n}" for n in range(18))]
    values = np.linspace(0.1, 1, 600).reshape(20, 30)
    labels = [f"a group with many words {n} $x$" for n in range(30)]
    for width in (3.3, None):
        sheet = Sheet(width)
        figures = [
            draw_by_condition(names, values, labels, [7] * 30, HIT, "weather", sheet=sheet),
            draw_heat_map(names, labels, values, HIT, sheet),
            draw_intervals(names, values[:, 0], np.full((20, 2), NAN), HIT, "", sheet),
        ]
        for figure in figures:
            check_room(figure)
            assert len(figure_bytes(figure, "png")) > 4000
            assert figure.get_figheight() < 16


HIT_OF_RECONSTRUCTION = next(
    column for column in reconstruction_method("a", 0).result.columns if column.headline
)
