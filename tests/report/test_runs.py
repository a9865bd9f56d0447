"""Pictures of single runs: matches, arrows, tiles, clouds, and what runs leave for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.report import draw
from airzoo_bench.report.matching import arrow_factor, read_matches
from airzoo_bench.report.reconstruction import error_limit, read_clouds
from tests.matching import world as matching
from tests.reconstruction import world as reconstruction
from tests.report.made import made_page, run, texts_of, write_photo_results
from tests.support import run_main


@pytest.fixture(scope="module")
def matched(tmp_path_factory: pytest.TempPathFactory) -> tuple[matching.World, Path]:
    """Return a world, and a run of perfect matches of which a query has none."""
    folder = tmp_path_factory.mktemp("matching")
    world = matching.make_world(folder / "world")
    path, out = world.write(folder / "m.npz", world.matches()), folder / "out"
    ask = ("--data", world.root, "--out", out, "--figures")
    assert run_main("eval", "matching", path, *ask) == 0
    return world, out


def test_matches_are_kept_with_their_residual_under_the_true_pose(
    matched: tuple[matching.World, Path],
) -> None:
    world, out = matched
    names = {path.name for path in (out / "figures").iterdir()}
    pictures = {f"hills_q{number}_matches.png" for number in range(5)}
    assert names == {"errors.png", "hills_map.png", "matches.npz"} | pictures
    found = read_matches(out)
    assert found is not None
    assert found.queries.tolist() == world.truth.queries["id"].tolist()
    # Matches of the world are exact, up to the rounding of the surface between its pixels.
    assert np.nanmedian(found.residual_px) < 0.5
    np.testing.assert_allclose(found.centres, world.truth.poses.centres, atol=0.5)
    assert (found.counts[:, 0] <= found.counts[:, 1]).all()
    assert len(found.inliers) == found.offsets[-1] <= 5 * 400


def test_lines_are_coloured_by_residual_and_arrows_are_magnified(
    matched: tuple[matching.World, Path],
) -> None:
    world, out = matched
    figure = draw.draw_run("query", [out], data=world.root, query="hills/q0")
    found = read_matches(out)
    assert found is not None
    lines = figure.axes[0].lines
    assert len(lines) == found.offsets[1]
    assert "inlier" in texts_of(figure)
    # All are below the limit, so none is vermilion.
    assert not any(np.allclose(line.get_color(), np.array((213, 94, 0)) / 255) for line in lines)
    said = texts_of(draw.draw_run("map", [out], data=world.root))
    assert f"errors × {arrow_factor(np.array([0.001]), 600)}" in said
    with pytest.raises(UsageError, match="did you mean"):
        draw.draw_run("query", [out], data=world.root, query="hills/qO")


def test_the_factor_of_arrows_is_round_and_fits_nine_of_ten() -> None:
    assert arrow_factor(np.array([1.0]), 1000) == 50
    assert arrow_factor(np.array([1.0, np.inf, np.nan]), 1000) == 50
    assert arrow_factor(np.array([900.0]), 1000) == 1
    assert arrow_factor(np.array([np.inf]), 1000) == 1000


def test_a_report_shows_what_a_run_has_kept(
    matched: tuple[matching.World, Path], tmp_path: Path
) -> None:
    world, out = matched
    page = made_page(tmp_path, out, "--data", world.root)
    [found] = page.parts[0]["maps"]
    centres = page.unpack(found["centres"]).reshape(-1, 2)
    tips = page.unpack(found["tips"]).reshape(-1, 2)
    assert found["factor"] > 1
    assert np.abs(tips.astype(int) - centres).max() < 0.1 * 4 * found["width"]
    matches = [name for name in page.images if "matches of" in name]
    assert matches or not page.parts[0]["queries"]


def test_without_figures_the_command_says_how_to_have_them(
    matched: tuple[matching.World, Path], tmp_path: Path
) -> None:
    world, _ = matched
    path, out = world.write(tmp_path / "p.npz", world.poses()), tmp_path / "out"
    assert run_main("eval", "matching", path, "--data", world.root, "--out", out) == 0
    done = run("plot", "map", out, "--data", world.root, "-o", tmp_path / "x.png")
    assert "--figures" in str(done.exception)
    figures = ("eval", "matching", path, "--data", world.root, "--figures")
    assert run_main(*figures) == 2  # without a folder to write into


def test_tiles_and_hits_of_retrieval_are_drawn(tmp_path: Path) -> None:
    data, [result] = write_photo_results(tmp_path, ["first"])
    out = tmp_path / "x.png"
    for ask in (("map",), ("query", "--query", "park/p00")):
        done = run("plot", ask[0], result, *ask[1:], "--data", data, "-o", out)
        assert done.exit_code == 0, (done.output, done.exception)
        assert out.stat().st_size > 10_000
    titles = [
        axes.get_title()
        for axes in draw.draw_run("query", [result], data=data, query="park/p00").axes
    ]
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
    kept = read_clouds(out)["lot"]
    assert len(kept.predicted) == len(kept.precision_m) > 0
    assert kept.precision_m.max() <= 0.25 + 1e-3
    np.testing.assert_allclose(kept.true.mean(axis=0), 0.0, atol=1.0)
    axes = draw.draw_run("cloud", [out], "lot").axes
    precision = next(line for line in axes[2].lines if line.get_label() == "precision")
    np.testing.assert_allclose(precision.get_ydata(), 100 * kept.curve[1])
    page = made_page(tmp_path, out, "--data", world.root)
    packed = page.parts[0]["clouds"]
    assert len(packed) == 4
    cloud = next(one for one in packed if "predicted" in one["title"] and "0.5 m" in one["about"])
    assert len(page.unpack(cloud["points"])) == 3 * len(page.unpack(cloud["codes"]))


def test_the_scale_of_errors_is_round_and_fits_nine_of_ten() -> None:
    assert error_limit([np.linspace(0, 4.4, 100)]) == 5
    assert error_limit([np.full(10, 0.02), np.full(1, np.inf)]) == 0.02
    assert error_limit([np.full(3, np.inf)]) == 1
