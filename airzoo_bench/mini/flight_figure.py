"""A flight as a picture: from above, and its altitude and pitch over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.matplotlib_loader import default_style
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.mini.trajectory import Trajectory, trajectory_poses
from airzoo_bench.mini.world import CRS, Region
from airzoo_bench.report.figures import COLOURS, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_flight"]

_ARROWS = 80
_WHOLE = {"path.simplify": False}
_LONGEST = 3_000  # points drawn; denser ones would show through each other


def draw_flight(trajectory: Trajectory, region: Region, path: Path, title: str) -> None:
    """Draw a flight over its region as PNG.

    On the left the way from above, coloured by altitude, with arrows where the camera looks, long
    at the horizon and short straight down; on the right altitude, pitch and yaw over time.

    Parameters
    ----------
    trajectory : Trajectory
        N frames.
    region : Region
    path : Path
    title : str
    """
    step = -(-len(trajectory) // _LONGEST)
    shown = trajectory.take(slice(None, None, step))
    poses = trajectory_poses(shown, CRS)
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
    axes.quiver(
        *place[some, :2].T,
        *forward[some, :2].T,
        angles="xy",
        scale_units="xy",
        scale=1 / 40.0,
        width=0.0025,
        color=COLOURS[1],
        zorder=3,
    )
    axes.set(xlim=(0.0, region.side_m), ylim=(0.0, region.side_m), aspect="equal")
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.figure.colorbar(lines, ax=axes, label="altitude, m")
