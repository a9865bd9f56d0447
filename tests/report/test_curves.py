"""Pictures of methods side by side: what they show, how they are written, and hostile names."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from airzoo_bench.cli.plot import parse_length
from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.report import draw
from airzoo_bench.report.curves import error_shares, longest_list, recall_curve
from airzoo_bench.report.figures import (
    figure_bytes,
    label_text,
    lacking_letters,
    save_figure,
    series_style,
)
from airzoo_bench.report.labels import axis_label
from airzoo_bench.report.sheet import Sheet, check_room
from airzoo_bench.results.records import Scored
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
        assert (
            "benchmark made, version 1; protocol made, version 1: 40 queries in 2 scenes"
            in texts_of(figure)
        )
    assert "protocol made, version 1: 3 scenes" in texts_of(
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
        assert parse_length(text) == pytest.approx(inches)
        return
    with pytest.raises(UsageError, match="no width"):
        parse_length(text)


@pytest.mark.parametrize(
    ("text", "said"), [("1in", "small"), ("2m", "no width"), ("99in", "large")]
)
def test_widths_that_cannot_be(text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        parse_length(text)


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


@pytest.mark.parametrize("width", [2.5, 3.3, 6.4])
def test_text_around_a_picture_stays_on_it(width: float) -> None:
    methods = [retrieval_method("a method", 0), retrieval_method("b method", 1)]
    sheet = Sheet(width, "A title of MANY WIDE WORDS, more than stand on a line of one column " * 2)
    figure = draw.condition(methods, ERROR, "weather", None, sheet)
    figure.draw_without_rendering()
    for text in figure.texts:
        extent = text.get_window_extent()
        assert extent.x0 >= 0
        assert extent.x1 <= figure.bbox.x1
        assert extent.y1 <= figure.bbox.y1
    assert sheet.title.split() == " ".join(figure.texts[-1].get_text().split()).split()


def test_panels_that_a_height_squeezes_to_nothing_are_refused() -> None:
    methods = [reconstruction_method("a", 0)]
    with pytest.raises(UsageError, match="too little"):
        check_room(draw.thresholds(methods, Sheet(3.3, height_in=1.9)))
    check_room(draw.thresholds(methods, Sheet(3.3, height_in=4)))


def test_small_print_left_out_is_handed_over() -> None:
    aside: list[str] = []
    figure = draw.errors([retrieval_method("a", 0)], ERROR, Sheet(3.3, aside=aside))
    assert texts_of(figure) == ""
    assert aside[0] == "benchmark made, version 1; protocol made, version 1: 40 queries in 2 scenes"
    assert "off the axis" in aside[1]
    assert figure.get_figheight() < draw.errors([retrieval_method("a", 0)], ERROR).get_figheight()


def test_bare_says_the_small_print_on_stderr(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 0)])
    done = run("plot", "recall", *paths, "--bare", "-o", tmp_path / "x.svg")
    assert "protocol made, version 1: 40 queries in 2 scenes" in done.stderr
    assert "40 queries" not in (tmp_path / "x.svg").read_text()


def test_one_scene_as_if_it_were_all() -> None:
    methods = [retrieval_method("a", 0), retrieval_method("b", 1)]
    east = draw.of_scene(methods, "east")
    figure = draw.recall(east)
    ranks = methods[0].records.loc[methods[0].records["scene"] == "east", "first_hit_rank"]
    assert figure.axes[0].lines[0].get_ydata()[0] == pytest.approx(100 * (ranks == 1).mean())
    assert "mean over scenes" not in figure.axes[0].get_ylabel()
    title = methods[0].result.truth.scene_titles["east"]
    assert f"20 queries in scene {title}" in texts_of(figure)
    assert f"scene {title}; bars" in texts_of(draw.intervals(east, HIT))
    assert methods[0].result.overall["error_m"] != east[0].result.overall["error_m"]
    with pytest.raises(UserError, match="no scene 'eats'"):
        draw.of_scene(methods, "eats")


def test_no_letters_of_a_narrow_picture_are_below_6_points() -> None:
    methods = [retrieval_method("a", 0), retrieval_method("b", 1)]
    sheet = Sheet(3.3)
    for figure in (
        draw.recall(methods, None, sheet),
        draw.errors(methods, ERROR, sheet),
        draw.intervals(methods, HIT, sheet),
        draw.scenes(methods, ERROR, sheet),
        draw.condition(methods, ERROR, "weather", None, sheet),
        draw.thresholds([reconstruction_method("a", 0)], sheet),
    ):
        figure.draw_without_rendering()
        texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
        assert min(text.get_fontsize() for text in texts) >= 6


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


def test_letters_that_the_font_lacks_are_told(tmp_path: Path) -> None:
    method = retrieval_method("数据 \N{ROCKET} é", 0)
    assert lacking_letters(draw.recall([method])) == "数据\N{ROCKET}"
    assert lacking_letters(draw.intervals([retrieval_method("é", 0)], HIT)) == ""
    paths = write_methods(tmp_path, [method])
    done = run("plot", "recall", *paths, "-o", tmp_path / "x.png")
    assert "boxes stand for what the font, DejaVu Sans, lacks: 数 据" in done.stderr
    done = run("plot", "recall", *paths, "-o", tmp_path / "x.svg")
    assert "boxes" not in done.stderr


@pytest.mark.parametrize("name", ["", " \t "])
def test_a_blank_name_says_that_it_is_none(name: str) -> None:
    method, other = retrieval_method(name, 0), retrieval_method("b", 1)
    method.records["ranked"] = 3
    figure = draw.recall([method, other])
    [legend] = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["(no name)", "b"]
    assert "lists end earlier: (no name) at 3" in texts_of(figure)
    assert "(no name) " in texts_of(draw.errors([method], ERROR))
    for drawn in (draw.intervals([method], HIT), draw.scenes([method], HIT)):
        assert drawn.axes[0].get_yticklabels()[0].get_text() == "(no name)"


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
        (("errors", "--score", "R@1", "-o", "x.png"), "no error"),
        (("scenes", "--score", "recall@", "-o", "x.png"), "'recall@1'"),
        (("recal", "-o", "x.png"), "did you mean 'recall'"),
        (("recall", "--width", "wide", "-o", "x.png"), "no width"),
        (("recall", "--height", "tall", "-o", "x.png"), "no height"),
        (("recall", "--scene", "eats", "-o", "x.png"), "no scene 'eats'"),
    ],
)
def test_what_cannot_be_drawn(tmp_path: Path, ask: tuple[object, ...], said: str) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("a", 0)])
    where = [tmp_path / a if str(a).startswith("x.") else a for a in ask]
    done = run("plot", where[0], path, *where[1:])
    assert isinstance(done.exception, UserError)
    assert said in str(done.exception)
    assert not list(tmp_path.glob("x.*"))


@pytest.mark.parametrize(
    ("kind", "option"),
    [
        ("recall", "--by"),
        ("scenes", "--bins"),
        ("recall", "--score"),
        ("errors", "--up-to"),
        ("scenes", "--scene"),
    ],
)
def test_an_option_of_another_kind(tmp_path: Path, kind: str, option: str) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("a", 0)])
    done = run("plot", kind, path, option, "1", "-o", tmp_path / "x.png")
    assert done.exit_code == 2
    assert f"No such option: {option}" in done.output
    assert not list(tmp_path.glob("x.*"))


def test_dots_per_inch(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("a", 0)])
    widths = []
    for dpi in (None, 150, 300):
        out = tmp_path / "x.png"
        asked = () if dpi is None else ("--dpi", dpi)
        assert run("plot", "recall", path, "--width", "3in", "-o", out, *asked).exit_code == 0
        with Image.open(out) as picture:
            widths.append(picture.width)
            assert picture.info["dpi"] == pytest.approx((dpi or 150, dpi or 150), abs=0.1)
    assert widths == [450, 450, 900]
    done = run("plot", "recall", path, "--dpi", 300, "-o", tmp_path / "x.pdf")
    assert "--dpi is for .png" in str(done.exception)


def test_a_kind_left_out_is_told_how_to_fix(tmp_path: Path) -> None:
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
