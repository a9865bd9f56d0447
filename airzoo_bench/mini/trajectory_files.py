"""Files of flights, CSV and JSON, that people write by hand and with other tools."""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import CameraError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.settings import SAFE_NAME
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.mini.trajectory import Trajectory, rounded
from airzoo_bench.mini.trajectory_table import TrajectoryTable, read_table
from airzoo_bench.mini.weather import TIMES, WEATHERS

__all__ = ["read_trajectory", "write_trajectory"]

_BOUNDS = {
    "longitude": (-180.0, 180.0),
    "latitude": (-90.0, 90.0),
    "roll": (-180.0, 180.0),
    "pitch": (-90.0, 90.0),
    "yaw": (-360.0, 360.0),
}


def read_trajectory(path: Path) -> Trajectory:
    """Read a flight from CSV, a frame a line, or JSON, a list of objects under ``frames``.

    Columns, or keys: longitude, latitude, altitude, roll, pitch, yaw, time; if wanted name (by
    default the row's number, from 000000), weather, time_of_day. Others are left aside.

    Raises
    ------
    CameraError
        See `trajectory_table.read_table`; and values that cannot be: not finite, out of bounds,
        longitude and latitude swapped, times that do not ascend, names that are no names of files
        or stand twice, an unknown weather or time of day. Rows are named by their line.
    """
    table = read_table(path)
    numbers = {name: table.numbers(name) for name in (*_BOUNDS, "altitude", "time")}
    _check_bounds(table, numbers)
    _check_times(table, numbers["time"])
    return Trajectory(
        names=_names(table),
        time_s=numbers["time"],
        lonlat=np.stack((numbers["longitude"], numbers["latitude"]), axis=-1),
        altitude_m=numbers["altitude"],
        roll_deg=numbers["roll"],
        pitch_deg=numbers["pitch"],
        yaw_deg=numbers["yaw"],
        weather=_words(table, "weather", WEATHERS),
        time_of_day=_words(table, "time_of_day", TIMES),
    )


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a flight as CSV or JSON, by the path's ending, with the digits of `rounded`.

    The same flight gives the same bytes.

    Raises
    ------
    CameraError
        Another ending.
    UserError
        It cannot be written.
    """
    writers = {".csv": _csv, ".json": _json}
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise CameraError("trajectories are .csv or .json", where=path, mend="name it so")
    text = writer(_cells(rounded(trajectory)))
    with atomic_write(path, "w") as stream:
        stream.write(text)


def _check_bounds(table: TrajectoryTable, numbers: dict[str, Floats]) -> None:
    longitude, latitude = numbers["longitude"], numbers["latitude"]
    table.refuse(
        (np.abs(latitude) > 90.0) & (np.abs(longitude) <= 90.0),
        "latitude is beyond 90 degrees",
        [f"{lat:g}" for lat in latitude],
        expected="degrees of WGS84, with latitude between -90 and 90",
        mend="longitude and latitude look swapped: exchange the two columns",
    )
    for name, (low, high) in _BOUNDS.items():
        values = numbers[name]
        table.refuse(
            (values < low) | (values > high),
            f"{name} is out of bounds",
            [f"{value:g}" for value in values],
            expected=f"degrees from {low:g} to {high:g}",
            mend="pitch is 0 at the horizon and -90 straight down" if name == "pitch" else None,
        )


def _check_times(table: TrajectoryTable, time_s: Floats) -> None:
    late: Bools = np.append(False, np.diff(time_s) <= 0.0)
    table.refuse(
        late,
        "time does not ascend",
        [f"{value:.15g}" for value in time_s],
        expected="seconds, each later than the one before",
        mend="sort the frames by time, and keep one of each time",
    )


def _names(table: TrajectoryTable) -> tuple[str, ...]:
    if "name" not in table.columns:
        return tuple(f"{row:06d}" for row in range(len(table)))
    names = table.texts("name")
    table.refuse(
        np.array([re.fullmatch(SAFE_NAME, name) is None for name in names]),
        "name cannot be that of a file",
        names,
        expected="a letter or digit, then at most 63 of letters, digits, '.', '_' and '-'",
    )
    # Some disks do not tell capitals from small letters.
    count = Counter(name.casefold() for name in names)
    table.refuse(
        np.array([count[name.casefold()] > 1 for name in names]),
        "name stands more than once",
        names,
        expected="each once, whether in capitals or small letters",
    )
    return names


def _words(table: TrajectoryTable, column: str, known: tuple[str, ...]) -> tuple[str, ...] | None:
    if column not in table.columns:
        return None
    words = table.texts(column)
    table.refuse(
        np.array([word not in known for word in words]),
        f"unknown {column}",
        words,
        expected=f"one of {', '.join(known)}",
    )
    return words


def _cells(trajectory: Trajectory) -> dict[str, list[Any]]:
    """Return the columns of a file, in their order."""
    texts: dict[str, list[Any]] = {"name": list(trajectory.names)}
    if trajectory.weather is not None:
        texts["weather"] = list(trajectory.weather)
    if trajectory.time_of_day is not None:
        texts["time_of_day"] = list(trajectory.time_of_day)
    numbers = {
        "longitude": trajectory.lonlat[:, 0],
        "latitude": trajectory.lonlat[:, 1],
        "altitude": trajectory.altitude_m,
        "roll": trajectory.roll_deg,
        "pitch": trajectory.pitch_deg,
        "yaw": trajectory.yaw_deg,
        "time": trajectory.time_s,
    }
    return texts | {name: values.tolist() for name, values in numbers.items()}


def _csv(cells: dict[str, list[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(cells)
    writer.writerows(zip(*cells.values(), strict=True))
    return text.getvalue()


def _json(cells: dict[str, list[Any]]) -> str:
    rows = [dict(zip(cells, row, strict=True)) for row in zip(*cells.values(), strict=True)]
    return json.dumps({"frames": rows}, indent=1, allow_nan=False) + "\n"
