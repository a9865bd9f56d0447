"""Pictures of reconstruction: colours at the limit, cells, and files that are the same again."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
import pytest
from PIL import Image

from airzoo_bench.reconstruction.metrics import curve, even_thresholds
from airzoo_bench.report.reconstruction import draw_curve, draw_error_map, error_colours

VERMILION = (213, 94, 0)


def test_colours_run_up_to_the_limit_and_change_there() -> None:
    just_below = np.nextafter(10.0, 0.0)
    colours = error_colours(np.array([0.0, 5.0, just_below, 10.0, 11.0, np.inf]), 10.0)
    table = matplotlib.colormaps["viridis"]
    for row, step in ((0, 0), (1, 128), (2, 255)):
        np.testing.assert_array_equal(colours[row], np.round(np.array(table(step)[:3]) * 255))
    assert (colours[3:] == VERMILION).all()
    assert colours.dtype == np.uint8
    assert len(error_colours(np.zeros(0), 10.0)) == 0


@pytest.mark.parametrize("limit", [0.1, 0.3, 10.0])
def test_no_distance_below_the_limit_has_its_colour(limit: float) -> None:
    distances = np.linspace(0.0, 2 * limit, 4001)
    beyond = (error_colours(distances, limit) == VERMILION).all(axis=1)
    np.testing.assert_array_equal(beyond, distances >= limit)


def grid(side: int = 60) -> np.ndarray:
    x, y = np.meshgrid(np.arange(side) + 0.5, np.arange(side) + 0.5)
    return np.stack([x.ravel() + 401_000, y.ravel() + 3_120_000, np.zeros(x.size)], axis=1)


def colours_in(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).reshape(-1, 3)


@pytest.mark.parametrize("limit", [0.1, 10.0])
def test_cells_beyond_the_limit_are_told_apart(limit: float, tmp_path: Path) -> None:
    points = grid()
    east = points[:, 0] > 401_030
    draw_error_map(tmp_path / "m.png", points, np.where(east, np.inf, 0.2 * limit), limit, "city")
    draw_error_map(tmp_path / "n.png", points, np.full(len(points), 0.9 * limit), limit, "city")
    some, none = (
        (colours_in(tmp_path / name) == VERMILION).all(axis=1).sum() for name in ("m.png", "n.png")
    )
    # Without any, only the arrow of the colour bar has it.
    assert none < 2000
    assert some > 50_000


def test_north_is_up_and_east_is_right(tmp_path: Path) -> None:
    points = grid()
    north_east = (points[:, 0] > 401_040) & (points[:, 1] > 3_120_040)
    draw_error_map(tmp_path / "m.png", points, np.where(north_east, 20.0, 0.0), 10.0, "city")
    with Image.open(tmp_path / "m.png") as image:
        pixels = np.asarray(image.convert("RGB"))
    left = pixels[:, : int(0.8 * pixels.shape[1])]  # without the colour bar
    dark = (np.abs(left.astype(int) - (68, 1, 84)) < 3).all(axis=2)
    rows, columns = np.nonzero((left == VERMILION).all(axis=2))
    true_rows, true_columns = np.nonzero(dark)
    assert rows.mean() < true_rows.mean()
    assert columns.mean() > true_columns.mean()


@pytest.mark.parametrize(
    "points",
    [np.zeros((0, 3)), np.ones((1, 3)), np.ones((5, 3)), grid()[:60]],
    ids=["none", "one", "a place", "a line"],
)
def test_clouds_without_an_area(points: np.ndarray, tmp_path: Path) -> None:
    draw_error_map(tmp_path / "m.png", points, np.zeros(len(points)), 10.0, "city")
    assert (tmp_path / "m.png").stat().st_size > 1000


def test_curves_are_the_same_bytes_again(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    found = curve(random.exponential(3, 500), random.exponential(9, 400), even_thresholds(20, 50))
    for name in ("a.png", "b.png"):
        draw_curve(tmp_path / name, found, 10.0, "city")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
