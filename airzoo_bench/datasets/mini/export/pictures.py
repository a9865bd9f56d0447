"""Pictures of a world for people: its maps, a place in every condition, and flights."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.mini.flights.patterns import barrel_roll, survey
from airzoo_bench.datasets.mini.flights.trajectory import Airspace, Trajectory, trajectory_poses
from airzoo_bench.datasets.mini.rendering.renderer import Renderer, default_camera
from airzoo_bench.datasets.mini.rendering.weather import TIMES, WEATHERS
from airzoo_bench.datasets.mini.world.model import Region, World
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rotations import angles_to_rotations
from airzoo_bench.report.figures import COLOURS, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_flight", "draw_world"]

_CLOSE_M = 150.0  # side of the close look at the maps
_VIEWS = (("looking down", -90.0), ("oblique", -40.0), ("to the horizon", -12.0))
_IN_CONDITIONS = -40.0
_SHADE = np.array((-0.5, 0.5, 0.7)) / np.sqrt(0.99)

_LABEL_PX, _GAP_PX = 18, 6
_PAPER, _INK = (250, 250, 250), (20, 20, 20)

_ARROWS = 80
_WHOLE = {"path.simplify": False}
_LONGEST = 3_000  # points drawn; denser ones would show through each other


def draw_world(world: World, folder: Path, progress: Progress = silent) -> list[Path]:
    """Draw a world into JPEG and PNG files of a folder; returns them."""
    name = world.region.name
    maps, views, conditions = (
        folder / f"{name}-{what}.jpg" for what in ("maps", "views", "conditions")
    )
    write_contact_sheet(*_maps(world), maps, columns=3, width_px=420)
    renderer, airspace = Renderer(world), Airspace.over(world.region, world.dsm)
    taken = [_photo(renderer, airspace, pitch, "sunny", "day") for _, pitch in _VIEWS]
    write_contact_sheet(taken, [label for label, _ in _VIEWS], views, columns=3, width_px=480)
    pairs = [(weather, time) for time in TIMES for weather in WEATHERS]
    shown = progress(pairs, f"{name}, conditions", len(pairs))
    photos = [_photo(renderer, airspace, _IN_CONDITIONS, *pair) for pair in shown]
    labels = [f"{weather}, {time}" for weather, time in pairs]
    write_contact_sheet(photos, labels, conditions, columns=5, width_px=300)
    flights = [folder / f"{name}-{flight}.png" for flight in ("barrel-roll", "survey")]
    flown = (barrel_roll(airspace, world.seed), survey(airspace))
    for path, flight in zip(flights, flown, strict=True):
        draw_flight(flight, world.region, path, path.stem)
    return [maps, views, conditions, *flights]


def _maps(world: World) -> tuple[list[NDArray[np.uint8]], list[str]]:
    """Return map, older map and surface, whole and close."""
    whole = [world.dom, world.satellite, _shaded(world)]
    labels = ["orthophoto", "older satellite mosaic", "surface model"]
    close = []
    for picture in whole:
        half = len(picture) // 2
        reach = round(len(picture) * (_CLOSE_M / world.region.side_m) / 2)
        middle = slice(half - reach, half + reach)
        close.append(picture[middle, middle])
    return whole + close, labels + [f"{label}, {_CLOSE_M:g} m" for label in labels]


def _shaded(world: World) -> NDArray[np.uint8]:
    """Light the surface model from the north-west."""
    step = world.region.side_m / len(world.dsm)
    south, east = np.gradient(world.dsm.astype(np.float64), step)
    normal = np.stack([-east, south, np.ones_like(east)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    grey = np.clip(normal @ _SHADE, 0, 1) * 255
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=-1)


def _photo(
    renderer: Renderer, airspace: Airspace, pitch_deg: float, weather: str, time: str
) -> NDArray[np.uint8]:
    """Take a photo from over the middle of the south, looking north."""
    region, height = airspace.region, airspace.floor_m + 20.0
    away = 0.0 if pitch_deg == -90.0 else 0.2
    centre = (region.west + region.side_m / 2, region.south + (0.5 - away) * region.side_m, height)
    rotation = angles_to_rotations(0.0, pitch_deg, 0.0, convergence_deg=0.0)
    pose = Poses.from_centres(rotation[None], np.array([centre]))
    return renderer.render(default_camera(), pose, weather, time, seed=0).rgb


def write_contact_sheet(
    images: Sequence[NDArray[np.uint8]],
    labels: Sequence[str],
    path: Path,
    *,
    columns: int,
    width_px: int,
) -> None:
    """Write pictures (H, W, 3) of any size in a grid as JPEG, each below its label.

    They are fitted into cells of `width_px`, whose shape is that of the first picture.
    """
    from PIL import Image, ImageDraw

    height_px = round(width_px * images[0].shape[0] / images[0].shape[1])
    cell = (width_px + _GAP_PX, height_px + _LABEL_PX + _GAP_PX)
    size = cell[0] * columns + _GAP_PX, cell[1] * ceil(len(images) / columns) + _GAP_PX
    sheet = Image.new("RGB", size, _PAPER)
    for number, (pixels, label) in enumerate(zip(images, labels, strict=True)):
        x, y = _GAP_PX + cell[0] * (number % columns), _GAP_PX + cell[1] * (number // columns)
        ImageDraw.Draw(sheet).text((x, y), label, fill=_INK)
        picture = Image.fromarray(pixels)
        scale = min(width_px / picture.width, height_px / picture.height)
        fitted = (max(round(picture.width * scale), 1), max(round(picture.height * scale), 1))
        sheet.paste(picture.resize(fitted, Image.Resampling.LANCZOS), (x, y + _LABEL_PX))
    with atomic_write(path) as stream:
        sheet.save(stream, format="JPEG", quality=88)


def draw_flight(trajectory: Trajectory, region: Region, path: Path, title: str) -> None:
    """Draw a flight over its region as PNG.

    On the left the way from above, coloured by altitude, with arrows where the camera looks, long
    at the horizon and short straight down; on the right altitude, pitch and yaw over time.
    """
    step = -(-len(trajectory) // _LONGEST)
    shown = trajectory.take(slice(None, None, step))
    poses = trajectory_poses(shown)
    place = poses.centres - (region.west, region.south, 0.0)
    with default_style(_WHOLE):
        figure, first = new_figure(11.0, 5.0)
        first.remove()
        layout = figure.add_gridspec(3, 2, width_ratios=(1.15, 1.0))
        _draw_map(figure.add_subplot(layout[:, 0]), place, poses.rotation[:, 2], region)
        curves = (
            ("altitude, m", shown.altitude_m),
            ("pitch, degrees", shown.pitch_deg),
            ("yaw, degrees", np.unwrap(shown.yaw_deg, period=360.0)),
        )
        for row, (label, values) in enumerate(curves):
            axes = figure.add_subplot(layout[row, 1])
            axes.plot(shown.time_s, values, color=COLOURS[row], linewidth=1.2)
            axes.set_ylabel(label)
            axes.grid(alpha=0.3)
        axes.set_xlabel("time, s")
        figure.suptitle(title)
        save_figure(figure, path, _WHOLE)


def _draw_map(axes: Axes, place: Floats, forward: Floats, region: Region) -> None:
    from matplotlib.collections import LineCollection

    pieces: Any = np.stack((place[:-1, :2], place[1:, :2]), axis=1)
    lines = LineCollection(pieces, cmap="viridis", linewidths=2.0, capstyle="round")
    lines.set_array((place[:-1, 2] + place[1:, 2]) / 2)
    axes.add_collection(lines)
    some = slice(None, None, max(1, len(place) // _ARROWS))
    arrows: Any = {"angles": "xy", "scale_units": "xy", "scale": 1 / 40.0, "width": 0.0025}
    axes.quiver(*place[some, :2].T, *forward[some, :2].T, **arrows, color=COLOURS[1], zorder=3)
    axes.set(xlim=(0.0, region.side_m), ylim=(0.0, region.side_m), aspect="equal")
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.figure.colorbar(lines, ax=axes, label="altitude, m")
