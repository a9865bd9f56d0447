"""Weather and time change photos and never geometry; photos depend on nothing but their input."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from airzoo_bench.datasets.mini import renderer as rendering
from airzoo_bench.datasets.mini.renderer import Renderer
from airzoo_bench.datasets.mini.weather import TIMES, WEATHERS
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from tests.datasets.mini.small_world import BLOCK, SIDE_M, small_world
from tests.datasets.mini.views import CORNER, HORIZON, NADIR, OBLIQUE, camera, pose, rays


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer(small_world())


@pytest.mark.parametrize("view", [NADIR, OBLIQUE, HORIZON])
def test_conditions_change_pixels_and_never_depth(renderer: Renderer, view: Poses) -> None:
    lens = camera(bent=True)
    frames = [
        renderer.render(lens, view, weather, time, 5) for weather, time in product(WEATHERS, TIMES)
    ]
    assert len({frame.depth.tobytes() for frame in frames}) == 1
    pictures = np.stack([frame.rgb for frame in frames]).astype(float)
    for first, second in product(range(15), range(15)):
        if first < second:
            assert np.abs(pictures[first] - pictures[second]).mean() > 1.0


def test_a_sunny_day_looks_like_the_orthophoto(renderer: Renderer) -> None:
    world = small_world()
    view = pose((48, 48, 70), 0, -90)
    frame = renderer.render(camera(320, 240), view, "sunny", "day", 1)
    points = rays(camera(320, 240), view) * frame.depth.ravel()[:, None]
    points += (view.centres - CORNER)[0]
    column = np.floor(points[:, 0] * 4).astype(int)
    row = np.floor((SIDE_M - points[:, 1]) * 4).astype(int)
    inside = ((points[:, :2] > 0) & (points[:, :2] < SIDE_M)).all(axis=1)
    column, row = column[inside], row[inside]
    on_top = np.abs(world.dsm[row // 2, column // 2] - points[inside, 2]) < 0.1
    photo = frame.rgb.reshape(-1, 3)[inside][on_top].astype(float)
    dom = world.dom[row, column][on_top].astype(float)
    assert on_top.mean() > 0.9
    np.testing.assert_allclose(photo.mean(axis=0), dom.mean(axis=0), atol=4.0)
    assert np.median(np.abs(photo - dom)) < 6.0
    assert np.corrcoef(photo.mean(axis=1), dom.mean(axis=1))[0, 1] > 0.9


def _at(frame_rgb: np.ndarray, lens: Cameras, view: Poses, point: tuple[float, ...]) -> float:
    local = view.rotation[0] @ (np.array(point) + CORNER - view.centres[0])
    x, y = lens.focal[0] * local[:2] / local[2] + lens.principal_point[0]
    return float(frame_rgb[int(y) - 1 : int(y) + 2, int(x) - 1 : int(x) + 2].mean())


def test_the_block_casts_its_shadow_where_it_should(renderer: Renderer) -> None:
    """8 m to the north of the wall, see test_render_raycast; none under clouds."""
    lens = camera(320, 240)
    shade, sun = (34.0, BLOCK[3] + 6.5, 20.0), (34.0, BLOCK[3] + 9.5, 20.0)
    sunny, cloudy = (renderer.render(lens, NADIR, w, "day", 1).rgb for w in ("sunny", "cloudy"))
    assert _at(sunny, lens, NADIR, shade) < 0.6 * _at(sunny, lens, NADIR, sun)
    assert _at(cloudy, lens, NADIR, shade) > 0.6 * _at(cloudy, lens, NADIR, sun)


def test_what_conditions_look_like(renderer: Renderer) -> None:
    def picture(weather: str, time: str) -> np.ndarray:
        return renderer.render(camera(), OBLIQUE, weather, time, 1).rgb.astype(float)

    day = picture("sunny", "day")
    assert picture("sunny", "night").mean() < 0.35 * day.mean()
    assert picture("foggy", "day").std() < 0.7 * day.std()
    snow = picture("snowy", "day")
    spread = snow.max(axis=-1) - snow.min(axis=-1)
    assert np.median(snow) > 130
    assert np.median(spread) < 30  # a little blue
    red = picture("sunny", "sunset")
    assert red[..., 0].mean() / red[..., 2].mean() > day[..., 0].mean() / day[..., 2].mean()


def test_the_same_input_gives_the_same_bytes(renderer: Renderer) -> None:
    first = renderer.render(camera(), OBLIQUE, "rainy", "sunset", 7).rgb
    renderer.render(camera(100, 80), NADIR, "snowy", "night", 8)
    again = renderer.render(camera(), OBLIQUE, "rainy", "sunset", 7).rgb
    fresh = Renderer(small_world()).render(camera(), OBLIQUE, "rainy", "sunset", 7).rgb
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, fresh)
    other = renderer.render(camera(), OBLIQUE, "rainy", "sunset", 8).rgb
    assert (first != other).any()
    assert np.abs(first.astype(int) - other).mean() < 6.0


def test_edges_are_blended(renderer: Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small photo with blended edges is nearer to the mean of a large one than without."""
    large = renderer.render(camera(640, 480), OBLIQUE, "cloudy", "day", 1).rgb.astype(float)
    mean = large.reshape(120, 4, 160, 4, 3).mean(axis=(1, 3))
    blended = renderer.render(camera(), OBLIQUE, "cloudy", "day", 1).rgb
    none = (np.zeros(0, np.int64), np.zeros((2, 0)))
    monkeypatch.setattr(rendering, "edge_pixels", lambda *_: none)
    sharp = renderer.render(camera(), OBLIQUE, "cloudy", "day", 1).rgb
    assert 0.01 < (blended != sharp).any(axis=-1).mean() < 0.3
    differ = np.abs(blended.astype(float) - sharp).mean(axis=-1) > 6.0
    assert differ.sum() > 100
    error = [np.abs(photo[differ] - mean[differ]).mean() for photo in (blended, sharp)]
    assert error[0] < 0.85 * error[1]
