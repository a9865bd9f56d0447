"""Which photos AirZoo-Mini is made of: two flights over each region, and their conditions.

The survey is flown on one day and serves reconstruction; the barrel roll goes through every weather
and time of day, so that retrieval and matching can be broken down by condition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Ints
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.mini.flights import Airspace, barrel_roll, survey
from airzoo_bench.mini.frame_list import FrameList
from airzoo_bench.mini.keyframes import key_frames
from airzoo_bench.mini.render import default_camera
from airzoo_bench.mini.trajectory import Trajectory, trajectory_poses
from airzoo_bench.mini.weather import TIMES, WEATHERS
from airzoo_bench.mini.world import CRS, Region

__all__ = ["ROLL", "SURVEY", "Photos", "mini_photos"]

SURVEY, ROLL = "survey", "roll"

_SURVEY_SIDE_M = 100.0
_SURVEY_SPACING_M = 50.0
_SURVEY_OVERLAP = 0.55
_ROLL_OVERLAP = 0.25
_ROLL_PHOTOS = 30  # each of the 15 conditions twice


@dataclass(frozen=True, eq=False)
class Photos:
    """The photos of a region.

    Attributes
    ----------
    frames : FrameList
    sequence : tuple of N str
        `SURVEY` or `ROLL`.
    """

    frames: FrameList
    sequence: tuple[str, ...]


def mini_photos(region: Region, dsm: NDArray[np.float32], seed: int) -> Photos:
    """Plan the photos of a region.

    Parameters
    ----------
    region : Region
    dsm : (H, W) float32 array
        Its surface model, which flights stay above.
    seed : int
        Of the barrel roll, the order of conditions, and the noise of the photos.
    """
    camera = default_camera()
    airspace = Airspace.over(region, dsm)
    surveyed = survey(airspace, side_m=_SURVEY_SIDE_M, spacing_m=_SURVEY_SPACING_M)
    rolled = barrel_roll(airspace, seed)
    first = key_frames(surveyed, camera, airspace.ground_m, _SURVEY_OVERLAP)
    second = _evenly(key_frames(rolled, camera, airspace.ground_m, _ROLL_OVERLAP), _ROLL_PHOTOS)
    flights = [(SURVEY, surveyed.take(first)), (ROLL, rolled.take(second))]
    sequence = tuple(name for name, flight in flights for _ in range(len(flight)))
    weather, time = _conditions(len(first), len(second), seed)
    frames = FrameList(
        names=_names(flights),
        cameras=camera,
        poses=_joined([flight for _, flight in flights]),
        weather=weather,
        time_of_day=time,
        seed=seed,
    )
    return Photos(frames, sequence)


def _evenly(rows: Ints, count: int) -> Ints:
    """Take so many of the rows, evenly spread; all where there are fewer."""
    if len(rows) <= count:
        return rows
    return rows[(np.arange(count) * len(rows)) // count]


def _conditions(sunny: int, changing: int, seed: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return sunny days, and then every weather and time of day in turn."""
    every = [(weather, time) for time in TIMES for weather in WEATHERS]
    # 7 has no factor in common with 15: all come by in an order that mixes them.
    turns = [every[(7 * number + seed) % len(every)] for number in range(changing)]
    both = [("sunny", "day")] * sunny + turns
    return tuple(weather for weather, _ in both), tuple(time for _, time in both)


def _names(flights: list[tuple[str, Trajectory]]) -> tuple[str, ...]:
    return tuple(
        f"{sequence}_{number:04d}" for sequence, flight in flights for number in range(len(flight))
    )


def _joined(flights: list[Trajectory]) -> Poses:
    parts = [trajectory_poses(flight, CRS) for flight in flights]
    # Photos are taken from where the truth will say, to the last bit.
    return Poses(
        rotation=np.concatenate([part.rotation for part in parts]),
        centres=np.concatenate([part.centres for part in parts]),
    ).rounded()
