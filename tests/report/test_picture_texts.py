"""Texts of pictures: what is said, where it stands, how large, and hostile names."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from matplotlib.text import Text

from airzoo_bench.core.errors import UserError
from airzoo_bench.report import draw
from airzoo_bench.report.figures import (
    label_text,
    lacking_letters,
    save_figure,
)
from airzoo_bench.report.labels import axis_label
from airzoo_bench.report.sheet import Sheet
from tests.report.made import (
    HOSTILE,
    reconstruction_method,
    retrieval_method,
    run,
    texts_of,
    write_methods,
)
from tests.statistics.support import CHAMFER, ERROR, HIT


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
