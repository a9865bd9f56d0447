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
    save_figure,
)
from airzoo_bench.report.labels import axis_label
from airzoo_bench.report.sheet import Sheet
from tests.report.made import (
    HOSTILE,
    reconstruction_method,
    retrieval_method,
    texts_of,
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
