"""Pictures of the matching track: what they show, and that they are the same bytes twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from rasterio import Affine

from airzoo_bench.report.curves import share_below
from airzoo_bench.report.figures import save_figure
from airzoo_bench.report.matching import draw_error_curves, draw_matches, draw_queries_on_map
from tests.matching.world import World, make_world
from tests.support import run_main

GREY = np.full((48, 64, 3), 128, np.uint8)
LIMITS = (5.0, 10.0, 20.0)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world"))


def saved(figure: Any, path: Path) -> bytes:
    save_figure(figure, path)
    with Image.open(path) as image:
        # A picture of one colour shows nothing.
        assert max(high - low for low, high in image.convert("RGB").getextrema()) > 100
    return path.read_bytes()


def errors(**scenes: list[float]) -> pd.DataFrame:
    rows = [(scene, value) for scene, values in scenes.items() for value in values]
    return pd.DataFrame(rows, columns=["scene", "error_m"])


def test_error_curves_end_at_the_share_that_was_posed(tmp_path: Path) -> None:
    table = errors(a=[np.inf, 3.0, 0.5, np.inf, 7.0], b=[1.0, 2.0], c=[np.inf, np.inf])
    draw = lambda: draw_error_curves(table, {"a": "A", "b": "B", "c": "C"}, LIMITS)  # noqa: E731
    axes = draw().axes[0]
    curves = {line.get_label(): line.get_xydata() for line in axes.lines[:1]}
    curves |= {x.get_label(): x.get_xydata() for x in axes.lines if "(n =" in str(x.get_label())}
    assert list(curves) == ["A (n = 5)", "B (n = 2)", "C (n = 2)"]
    # Strictly below: each height holds up to and with the error where it stands.
    np.testing.assert_allclose(
        curves["A (n = 5)"][1:], [[0.5, 0], [3, 20], [7, 40], [axes.get_xlim()[1], 60]]
    )
    styles = {x.get_drawstyle() for x in axes.lines if "(n =" in str(x.get_label())}
    assert styles == {"steps-pre"}
    assert [curve[-1, 1] for curve in curves.values()] == [60, 100, 0]
    marks = [x.get_xdata()[0] for x in axes.lines if "(n =" not in str(x.get_label())]
    assert marks == list(LIMITS)
    assert saved(draw(), tmp_path / "a.png") == saved(draw(), tmp_path / "b.png")


def test_an_error_at_the_threshold_is_not_below_it() -> None:
    [curve] = [
        line.get_xydata()
        for line in draw_error_curves(errors(a=[5.0, 5.0, 1.0]), {"a": "A"}, LIMITS).axes[0].lines
        if "(n =" in str(line.get_label())
    ]
    at_limit = dict(curve.tolist())[5.0]
    assert at_limit == pytest.approx(100 / 3)
    assert share_below(np.array([5.0, 5.0, 1.0]), np.array([5.0])) == pytest.approx(1 / 3)


@pytest.mark.parametrize("values", [[0.0], [np.inf], [1e-12, 1e9], [5.0, 5.0]])
def test_error_curves_of_few_queries(tmp_path: Path, values: list[float]) -> None:
    figure = draw_error_curves(errors(a=values), {"a": "A"}, LIMITS)
    left, right = figure.axes[0].get_xlim()
    assert 0 < left < 5
    assert right > 20
    saved(figure, tmp_path / "a.png")


def test_matches_are_drawn_by_kind(tmp_path: Path) -> None:
    inliers = np.arange(1000) % 4 == 0
    xy = np.random.default_rng(0).random((1000, 2)) * (64, 48)
    crop = np.full((96, 30, 3), 200, np.uint8)
    figure = draw_matches(GREY, crop, xy, xy[:, ::-1] / 2, inliers, "hills/q0")
    axes = figure.axes[0]
    assert "250 inliers of 1,000 matches" in axes.get_title()
    # At most 200 of each kind; outliers first, so that inliers lie above.
    drawn = [line for line in axes.lines if len(line.get_xdata())]
    colours = [line.get_color() for line in drawn]
    assert len(colours) == 400
    assert len(set(colours[:200])) == len(set(colours[200:])) == 1
    assert colours[0] != colours[-1]
    first = drawn[200].get_xydata()
    np.testing.assert_allclose(first[0], xy[0])
    # The crop is drawn half as large, to the right of the photo.
    np.testing.assert_allclose(first[1], xy[0, ::-1] / 4 + (64 * 1.02, 0))
    none = np.zeros(0, np.bool_)
    empty = np.zeros((0, 2))
    saved(draw_matches(GREY, crop, empty, empty, none, "t"), tmp_path / "n.png")


def test_failures_are_crosses_on_the_map(tmp_path: Path) -> None:
    truth = np.array([[500_010.0, 5_200_010.0], [500_020.0, 5_200_020.0]])
    estimate = np.array([[500_013.0, 5_200_014.0], [np.nan, np.nan]])
    extent = (500_000.0, 500_064.0, 5_200_000.0, 5_200_048.0)
    figure = draw_queries_on_map(GREY, extent, truth, estimate, "Hills")
    axes = figure.axes[0]
    vectors = [x.get_xydata().tolist() for x in axes.lines if x.get_marker() == "None"]
    assert vectors == [[[10, 10], [13, 14]]]
    crosses = [x.get_xydata().tolist() for x in axes.lines if x.get_marker() == "x"]
    assert crosses == [[[20, 20]]]
    whole = draw_queries_on_map(GREY, extent, truth, truth, "Hills")
    assert not [x for x in whole.axes[0].lines if x.get_marker() == "x"]
    saved(figure, tmp_path / "map.png")


@pytest.mark.parametrize("form", ["matches", "poses"])
def test_the_command_draws(world: World, tmp_path: Path, form: str) -> None:
    fields = getattr(world, form)()
    if form == "poses":
        fields["poses"][1] = np.nan
    path = world.write(tmp_path / "m.npz", fields)
    drawn = []
    for name in ("a", "b"):
        out = tmp_path / name
        ask = ("--data", world.root, "--out", out, "--figures")
        assert run_main("eval", "matching", path, *ask) == 0
        drawn.append({p.name: p.read_bytes() for p in (out / "figures").iterdir()})
    pictures = {f"hills_q{q}_matches.png" for q in range(5)} if form == "matches" else set()
    assert set(drawn[0]) == {"errors.png", "hills_map.png"} | pictures
    assert drawn[0] == drawn[1]


def test_figures_need_a_folder_and_photos(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = world.write(tmp_path / "m.npz", world.matches())
    ask = ("eval", "matching", path, "--data", world.root, "--figures")
    assert run_main(*ask) == 2
    assert "--out" in capsys.readouterr().err
    photo = world.root.parent / "sources" / "photos" / "q3.png"
    moved = photo.rename(tmp_path / "q3.png")
    try:
        assert run_main(*ask, "--out", tmp_path / "out") == 2
    finally:
        moved.rename(photo)
    assert "q3.png" in capsys.readouterr().err


def test_a_map_in_another_crs_still_lies_under_its_queries(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dataclasses import replace

    from pyproj import CRS

    from airzoo_bench.evaluation.evaluate import evaluate
    from airzoo_bench.evaluation.track import Run
    from airzoo_bench.geometry.crs import to_lonlat
    from airzoo_bench.report import matching as matching_figures

    path = world.write(tmp_path / "m.npz", world.poses())
    run = evaluate(path, data=world.root, run=Run(keep=True))
    truth, dom = run.truths[0], run.truths[0].maps[0].dom
    corner, east, south = to_lonlat(
        dom.crs, np.array([[5e5, 5.2e6], [5e5 + 600, 5.2e6], [5e5, 5.2e6 - 600]])
    )
    step = (east - corner) / 300, (south - corner) / 300
    turned = Affine(step[0][0], step[1][0], corner[0], step[0][1], step[1][1], corner[1])
    lonlat = replace(dom, crs=CRS.from_epsg(4326), transform=turned)
    seen = []

    def look(_: Any, extent: Any, truth_xy: Any, estimate_xy: Any, title: str) -> Any:
        seen.append((extent, truth_xy, estimate_xy))
        return draw_queries_on_map(GREY, extent, truth_xy, estimate_xy, title)

    monkeypatch.setattr(matching_figures, "draw_queries_on_map", look)
    reference = truth.maps[0]
    for number, one in enumerate((reference, replace(reference, dom=lonlat))):
        centres = np.array([found.centre for found in run.scored["hills"].details[1]])
        path = tmp_path / f"{number}.png"
        matching_figures._draw_map(truth, one, centres, "Hills", path)
    np.testing.assert_allclose(seen[0][0], (0, 600, 0, 600))
    expected = world.truth.poses.centres[:, :2] - (5e5, 5.2e6 - 600)
    np.testing.assert_allclose(seen[0][1], expected, atol=1e-6)
    for one, other in zip(*seen, strict=True):
        np.testing.assert_allclose(one, other, atol=0.05)
