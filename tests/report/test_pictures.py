"""Pictures: what they show, the same bytes, the command, and what runs leave for them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.matching.solving import Status
from airzoo_bench.report import draw
from airzoo_bench.report.figures import (
    Sheet,
    axis_label,
    error_colours,
    figure_bytes,
    label_text,
    over_scenes,
    parse_length,
    save_figure,
    series_style,
)
from airzoo_bench.report.matching import arrow_factor
from airzoo_bench.report.reconstruction import error_limit, read_clouds
from airzoo_bench.report.sections import need_kept, read_sections
from airzoo_bench.results.records import Method
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import breakdown_table
from tests.matching import world as matching
from tests.reconstruction import world as reconstruction
from tests.report.made import (
    HOSTILE,
    made_page,
    reconstruction_method,
    retrieval_method,
    run,
    write_methods,
    write_photo_results,
)
from tests.statistics.support import CHAMFER, ERROR, HIT, made_method
from tests.support import run_main

INF = np.inf


def texts_of(figure: Figure) -> str:
    """Return the text around the axes."""
    return "\n".join(text.get_text() for text in figure.texts)


def test_curves_are_means_over_scenes_and_errors_strictly_below() -> None:
    records = pd.DataFrame(
        {
            "scene": ["a", "a", "a", "a", "b", "b"],
            "first_hit_rank": [1, 2, 2, 0, 3, 1],
            "error_m": [1.0, INF, 1.0, INF, 1.0, 3.0],
        }
    )
    one = Method("a", retrieval_method("a", 0, queries=6).result, records)
    curve = draw.recall_curve(one, 4)
    np.testing.assert_allclose(curve, [(1 / 4 + 1 / 2) / 2, (3 / 4 + 1 / 2) / 2, 7 / 8, 7 / 8])
    shares = draw.error_shares(one, "error_m", np.array([1.0, 1.1, 3.0, 3.1, 1e9]))
    np.testing.assert_allclose(shares, [0, 0.5, 0.5, 0.75, 0.75])
    whole = retrieval_method("a", 3)
    assert draw.recall_curve(whole, 5)[0] == pytest.approx(whole.result.overall["recall@1"])
    alone = made_method({"s": {HIT.key: [1.0]}})
    assert [bool(over_scenes([method])) for method in (whole, alone)] == [True, False]


def test_a_line_ends_where_the_longest_list_does() -> None:
    short, long = retrieval_method("short", 0), retrieval_method("long", 1)
    short.records["ranked"], long.records["ranked"] = 3, 4
    figure = draw.recall([short, long])
    assert [line.get_xdata()[-1] for line in figure.axes[0].lines] == [3, 4]
    short.records["ranked"] = 0
    figure_bytes(draw.recall([short]), "png")
    with pytest.raises(UserError, match="keeps 5 ranks"):
        draw.recall([long], 9)


@pytest.mark.parametrize("most", [2.5, 5, 9.5, 21, 100, 500, 1e4, 1e6])
def test_an_axis_of_errors_has_three_labels_or_more(most: float) -> None:
    method = retrieval_method("a", 0)
    for least in (0.011, 0.21, 0.55, 1.0, 5.1):
        method.records[ERROR.key] = np.geomspace(least, least * most, len(method.records))
        axes = draw.errors([method], ERROR).axes[0]
        labels, (low, high) = [t.get_text() for t in axes.get_xticklabels()], axes.get_xlim()
        assert 3 <= sum(low <= float(one) <= high for one in labels if one) <= 10


def test_a_condition_shows_the_table_of_breakdown() -> None:
    method = retrieval_method("a", 0)
    axes = draw.condition([method], HIT, "weather").axes[0]
    rows = breakdown_table([method], [HIT], "weather", resampling=ResamplingConfig()).rows
    ticks = [text.get_text() for text in axes.get_xticklabels()]
    assert ticks == [f"{row.name} (n = {row.cells[1].value})" for row in rows]
    np.testing.assert_allclose(axes.lines[0].get_ydata(), [row.cells[2].value for row in rows])
    spans = [segment[:, 1].tolist() for segment in axes.collections[0].get_segments()]
    np.testing.assert_allclose(spans, [row.cells[2].uncertainty for row in rows])


def test_thresholds_are_those_of_the_protocol() -> None:
    method = reconstruction_method("a", 0)
    settings = {"scores": {"headline_below_m": 10.0}}
    used = method.result.protocol.model_copy(update={"settings": settings})
    result = method.result.model_copy(update={"protocol": used})
    figure = draw.thresholds([Method("a", result, method.records)])
    assert "d = 10 m, of the headline" in texts_of(figure)
    np.testing.assert_allclose(
        [axes.lines[0].get_ydata() for axes in figure.axes],
        [
            [100 * result.overall[f"{w}_{d}m"] for d in (1, 10)]
            for w in ("precision", "recall", "f1")
        ],
    )


def test_pictures_say_what_they_are_of_in_letters_that_can_be_read() -> None:
    methods, sheet = [retrieval_method("a", 0), retrieval_method("b", 1)], Sheet(3.3)
    for figure in (
        draw.recall(methods, None, sheet),
        draw.errors(methods, ERROR, sheet),
        draw.condition(methods, ERROR, "weather", None, sheet),
        draw.thresholds([reconstruction_method("a", 0)], sheet),
    ):
        assert "benchmark made, version 1; protocol" in texts_of(figure).replace("\n", " ")
        assert figure.get_figwidth() == 3.3
        texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
        assert min(text.get_fontsize() for text in texts) >= 6
    named = [axis_label(score) for score in (ERROR, CHAMFER, HIT)]
    assert named == ["median translation error [m]", "Chamfer distance [m]", "R@1 [%]"]
    assert len({tuple(series_style(n).values()) for n in range(196)}) == 196


@pytest.mark.parametrize("form", ["png", "svg", "pdf"])
def test_names_are_text_and_bytes_the_same_twice(tmp_path: Path, form: str) -> None:
    names = [HOSTILE, "_hidden", "数"]
    methods = [retrieval_method(name, number) for number, name in enumerate(names)]
    first, second = (tmp_path / f"{name}.{form}" for name in "ab")
    for path in (first, second):
        save_figure(draw.recall(methods), path)
    assert first.read_bytes() == second.read_bytes()
    assert len(first.read_bytes()) > 4000
    if form == "svg":
        root, space = ET.parse(first).getroot(), "{http://www.w3.org/2000/svg}"
        texts = {"".join(node.itertext()) for node in root.iter(f"{space}text")}
        assert {"_hidden", "数", label_text(HOSTILE).replace(r"\$", "$")} <= texts
        assert not list(root.iter(f"{space}script"))


@pytest.mark.parametrize("limit", [0.1, 0.3, 10.0])
def test_no_error_below_the_limit_has_the_colour_of_those_beyond(limit: float) -> None:
    errors = np.append(np.linspace(0.0, 2 * limit, 4001), [np.nextafter(limit, 0.0), INF])
    beyond = (error_colours(errors, limit) == (213, 94, 0)).all(axis=1)
    np.testing.assert_array_equal(beyond, errors >= limit)
    light = error_colours(np.array([0.0, 0.5 * limit, 0.99 * limit]), limit).sum(axis=1)
    assert (np.diff(light.astype(int)) > 0).all()


def test_scales_are_round_and_fit_nine_of_ten() -> None:
    assert error_limit(np.linspace(0, 4.4, 100)) == 5
    assert error_limit(np.append(np.full(10, 0.02), INF)) == 0.02
    assert error_limit(np.full(3, INF)) == 1
    for errors, factor in (([1.0], 50), ([1.0, INF, np.nan], 50), ([900.0], 1), ([INF], 1000)):
        assert arrow_factor(np.array(errors), 1000) == factor
    lengths = [parse_length(text) for text in (None, "3.3in", "8 cm")]
    assert lengths == [None, 3.3, pytest.approx(8 / 2.54)]


@pytest.mark.parametrize(
    "ask",
    [
        ("recall", "--up-to", 3),
        ("errors",),
        ("condition", "--by", "weather"),
        ("condition", "--by", "altitude_m", "--bins", "50,100"),
        ("condition", "--by", "scene", "--score", "error_m", "--width", "8.4cm"),
    ],
)
def test_every_kind_is_drawn_by_the_command(tmp_path: Path, ask: tuple[object, ...]) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 0), retrieval_method("b", 1)])
    done = run("plot", ask[0], *paths, *ask[1:], "-o", tmp_path / "x.svg")
    assert done.exit_code == 0, done.output
    assert "<svg" in (tmp_path / "x.svg").read_text()


def test_matches_and_errors_of_a_run_are_kept_drawn_and_reported(tmp_path: Path) -> None:
    world = matching.make_world(tmp_path / "world")
    fields = world.matches()
    # The fourth query has two matches, the last is missing.
    cut = {"query_ids": 4, "query_xy": (end := fields["offsets"][3] + 2), "map_xy": end}
    fields |= {name: fields[name][:count] for name, count in cut.items()}
    fields["offsets"] = np.append(fields["offsets"][:4], end)
    path, out = world.write(tmp_path / "m.npz", fields), tmp_path / "out"
    ask = ("--data", world.root, "--out", out, "--figures")
    assert run_main("eval", "matching", path, *ask) == 0
    assert {one.name for one in (out / "figures").iterdir()} == {"hills_map.png", "matches.npz"}
    found = need_kept(read_sections([out])[0])
    assert found["queries"].tolist() == world.truth.queries["id"].tolist()
    # Matches of the world are exact, up to the rounding of the surface between its pixels.
    assert np.nanmedian(found["residual_px"]) < 0.5
    np.testing.assert_allclose(found["centres"][:3], world.truth.poses.centres[:3], atol=0.5)
    assert (found["counts"][:, 0] <= found["counts"][:, 1]).all()
    assert len(found["inliers"]) == found["offsets"][-1] <= 5 * 400

    figure = draw.draw_run("query", [out], data=world.root, query="hills/q0")
    lines = figure.axes[0].lines[1::2]  # each above an outline
    assert len(lines) == found["offsets"][1]
    # All are below the limit, so none is vermilion.
    assert not any(np.allclose(line.get_color(), np.array((213, 94, 0)) / 255) for line in lines)
    figure = draw.draw_run("map", [out], data=world.root)
    assert f"errors × {arrow_factor(np.array([0.001]), 600)}" in texts_of(figure)
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert labels[:2] == ["no answer (1)", "no pose (1)"]
    few, missing = "no pose: too few matches (2)", f"no answer: {Status.MISSING}"
    for query, failure, panels in (("hills/q3", few, 2), ("hills/q4", missing, 1)):
        figure = draw.draw_run("query", [out], data=world.root, query=query)
        assert failure in texts_of(figure)
        assert len(figure.axes) == panels  # with a scale of colours where there are lines
    with pytest.raises(UsageError, match="did you mean"):
        draw.draw_run("query", [out], data=world.root, query="hills/qO")

    page = made_page(tmp_path, out, "--data", world.root)
    [packed] = page.parts[0]["maps"]
    centres, tips = (page.unpack(packed[name]).reshape(-1, 2) for name in ("centres", "tips"))
    assert packed["factor"] > 1
    assert np.abs(tips.astype(int) - centres)[:3].max() < 0.1 * 4 * packed["width"]
    queries = page.parts[0]["queries"]
    texts, codes = (page.unpack(queries["failures"][name]) for name in ("texts", "codes"))
    assert [texts[code] for code in codes] == ["", "", "", few, missing]
    assert [score["title"] for score in queries["scores"][1:3]] == ["matches", "inliers"]
    assert f"translation error [m]</span> <b>inf, {few}</b>" in page.text

    (out / "figures" / "matches.npz").unlink()
    done = run("plot", "map", out, "--data", world.root, "-o", tmp_path / "x.png")
    assert "--figures" in str(done.exception)
    figures: Any = ("eval", "matching", path, "--data", world.root, "--figures")
    assert run_main(*figures) == 2  # without a folder to write into


def test_tiles_and_hits_of_retrieval_are_drawn(tmp_path: Path) -> None:
    data, [result] = write_photo_results(tmp_path, ["first"])
    ask = ("--query", "park/p01", "--data", data, "-o", tmp_path / "x.png")
    assert run("plot", "query", result, *ask).exit_code == 0
    assert (tmp_path / "x.png").stat().st_size > 10_000
    figure = draw.draw_run("map", [result], data=data)
    assert figure.axes[0].get_legend_handles_labels()[1][0] == "no answer (1)"
    figure = draw.draw_run("query", [result], data=data, query="park/p00")
    assert (texts_of(figure), len(figure.axes)) == ("park/p00: no answer", 2)
    drawn = draw.draw_run("query", [result], data=data, query="park/p01").axes
    titles = [axes.get_title() for axes in drawn]
    assert titles[:2] == ["photo", "true place"]
    assert {title.split()[1] for title in titles[2:]} <= {"hit", "miss"}


def test_clouds_are_kept_and_drawn_by_their_errors(tmp_path: Path) -> None:
    world = reconstruction.make_world(tmp_path / "data")
    clouds = {scene: reconstruction.true_points(scene) for scene in ("lot", "yard")}
    clouds["lot"] += np.array([0.0, 0.0, 0.25])
    path = reconstruction.predict_clouds(world, tmp_path / "p", clouds, True)
    out = tmp_path / "out"
    ask = ("--data", world.root, "--out", out, "--figures")
    assert run_main("eval", "reconstruction", path, *ask) == 0
    kept = read_clouds(read_sections([out])[0])["lot"]
    assert len(kept["predicted"]) == len(kept["precision_m"]) > 0
    assert kept["precision_m"].max() <= 0.25 + 1e-3
    np.testing.assert_allclose(kept["true"].mean(axis=0), 0.0, atol=1.0)
    axes = draw.draw_run("cloud", [out], scene="lot").axes
    precision = next(line for line in axes[2].lines if line.get_label() == "precision")
    np.testing.assert_allclose(precision.get_ydata(), 100 * kept["curve"][1])
    page = made_page(tmp_path, out, "--data", world.root)
    packed = page.parts[0]["clouds"]
    assert len(packed) == 4
    cloud = next(one for one in packed if "predicted" in one["title"] and "0.5 m" in one["about"])
    assert len(page.unpack(cloud["points"])) == 3 * len(page.unpack(cloud["codes"]))
