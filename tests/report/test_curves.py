"""Pictures of methods side by side: what they show, how they are written, and hostile names."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from airzoo_bench.errors import UsageError, UserError
from airzoo_bench.records import Scored
from airzoo_bench.report import draw
from airzoo_bench.report.curves import error_shares, longest_list, recall_curve
from airzoo_bench.report.figures import figure_bytes, label_text, save_figure, series_style
from airzoo_bench.report.labels import axis_label
from airzoo_bench.report.sheet import Sheet, parse_width
from tests.report.made import HOSTILE, reconstruction_method, retrieval_method, run, write_methods
from tests.statistics.support import CHAMFER, ERROR, HIT


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


def test_a_picture_says_what_it_is_of() -> None:
    methods = [retrieval_method("a", 0)]
    for figure in (
        draw.recall(methods),
        draw.errors(methods, ERROR),
        draw.intervals(methods, HIT),
        draw.scenes(methods, HIT),
        draw.condition(methods, HIT, "weather"),
    ):
        assert "made v1, protocol made v1: 40 queries in 2 scenes" in texts_of(figure)
    assert "protocol made v1: 3 scenes" in texts_of(
        draw.thresholds([reconstruction_method("a", 0)])
    )


def test_scores_are_named_as_the_field_does() -> None:
    assert axis_label(ERROR) == "median translation error [m]"
    assert axis_label(CHAMFER) == "Chamfer distance [m]"
    assert axis_label(HIT) == "R@1 [%]"


def test_a_title_and_a_width_on_demand() -> None:
    methods = [retrieval_method("a", 0)]
    bare, titled = draw.recall(methods), draw.recall(methods, None, Sheet(3.3, "Of $x$"))
    assert titled.get_figwidth() == 3.3
    assert r"Of \$x\$" in texts_of(titled)
    assert bare.get_figwidth() != 3.3


@pytest.mark.parametrize(
    ("text", "inches"), [("3.3in", 3.3), ("8.4 cm", 8.4 / 2.54), (".5E", None)]
)
def test_a_width_is_in_inches_or_centimetres(text: str, inches: float | None) -> None:
    if inches is not None:
        assert parse_width(text) == pytest.approx(inches)
        return
    with pytest.raises(UsageError, match="no width"):
        parse_width(text)


@pytest.mark.parametrize(
    ("text", "said"), [("1in", "small"), ("2m", "no width"), ("99in", "large")]
)
def test_widths_that_cannot_be(text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        parse_width(text)


def texts_of(figure: Figure) -> str:
    """Return the text around the axes."""
    return "\n".join(text.get_text() for text in figure.texts)


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
        ("condition", "--by", "scene", "--score", "error_m", "--width", "8.4cm"),
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
    settings = {"scores": {"headline_below_m": 10.0}}
    used = methods[0].result.protocol.model_copy(update={"settings": settings})
    result = methods[0].result.model_copy(update={"protocol": used})
    figure = draw.thresholds([Scored("a", result, methods[0].records)])
    panels = figure.axes
    assert "d = 10 m, of the headline" in texts_of(figure)
    assert all(10 in axes.lines[-1].get_xdata() for axes in panels)
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
        (("recall", "-o", "x."), "without an ending"),
        (("recall", "--up-to", 9, "-o", "x.png"), "keeps 5 ranks"),
        (("condition", "-o", "x.png"), "needs --by"),
        (("condition", "--by", "wether", "-o", "x.png"), "'weather'"),
        (("recall", "--by", "weather", "-o", "x.png"), "--by does not go with"),
        (("scenes", "--bins", "1,2", "-o", "x.png"), "--bins does not go with"),
        (("recall", "--score", "R@1", "-o", "x.png"), "--score does not go with"),
        (("errors", "--up-to", 3, "-o", "x.png"), "--up-to does not go with"),
        (("errors", "--score", "R@1", "-o", "x.png"), "no error"),
        (("scenes", "--score", "recall@", "-o", "x.png"), "'recall@1'"),
        (("recal", "-o", "x.png"), "did you mean 'recall'"),
        (("recall", "--width", "wide", "-o", "x.png"), "no width"),
    ],
)
def test_what_cannot_be_drawn(tmp_path: Path, ask: tuple[object, ...], said: str) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("a", 0)])
    where = [tmp_path / a if str(a).startswith("x.") else a for a in ask]
    done = run("plot", where[0], path, *where[1:])
    assert isinstance(done.exception, UserError)
    assert said in str(done.exception)
    assert not list(tmp_path.glob("x.*"))


def test_a_kind_left_out_is_told_how_to_mend(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("a", 0)])
    done = run("plot", path, path, "-o", tmp_path / "x.png")
    assert "name the kind before the results" in str(done.exception)
    blocked = tmp_path / "file"
    blocked.write_text("")
    done = run("plot", "recall", path, "-o", blocked / "x.png")
    assert isinstance(done.exception, UserError)


def test_ranks_are_of_retrieval(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [reconstruction_method("a", 0)])
    done = run("plot", "recall", path, "-o", tmp_path / "x.png")
    assert "no ranks" in str(done.exception)
