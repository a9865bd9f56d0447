"""Rotations out of the angles of a table: what they mean, in which unit, from which north."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, UsageError, counted
from airzoo_bench.datasets.surveys.attitude import Convention, attitudes_to_rotations
from airzoo_bench.datasets.surveys.pose_table import PoseTable
from airzoo_bench.geometry.arrays import Floats

__all__ = ["AngleSettings", "angle_columns", "table_rotations"]

_YAW = ("yaw", "pitch", "roll")
_OMEGA = ("omega", "phi", "kappa")
_MOST_OFF_NADIR_DEG = 65.0
_TURN_DEG = 360.5
_MOST_AWAY = 0.5  # of the photos
_OBLIQUE_DEG = -20.0


@dataclass(frozen=True)
class AngleSettings:
    """What a table of poses may leave open.

    Attributes
    ----------
    convention : Convention or None
        None for what the columns' names say.
    unit : str or None
        None for degrees, unless all look like radians, which is refused.
    north : str or None
        What angles are relative to. None for true north with yaw, and the grid's with kappa.
    """

    convention: Convention | None = None
    unit: Literal["degrees", "radians"] | None = None
    north: Literal["true", "grid"] | None = None


def table_rotations(
    given: PoseTable, rows: list[int], angles: AngleSettings, convergence_deg: Floats
) -> tuple[Floats, str]:
    """Return the rotations of some rows of a table, and a sentence on how they were read."""
    convention = _convention(given, angles.convention)
    degrees = _degrees(given, rows, convention, angles.unit)
    north = angles.north or ("grid" if convention == "omega-phi-kappa" else "true")
    convergence = convergence_deg if north == "true" else 0.0
    rotations = attitudes_to_rotations(convention, degrees, convergence_deg=convergence)
    if angles.convention is None:
        _check_down(rotations, degrees, convention, given.table.path)
        _check_pitch(given, degrees, convention)
    return rotations, f"angles are read as {convention}, relative to {north} north"


def angle_columns(given: PoseTable) -> tuple[str, ...]:
    """Return the three columns of angles that a table has."""
    return _OMEGA if given.has(*_OMEGA) else _YAW


def _convention(given: PoseTable, wanted: Convention | None) -> Convention:
    """Return the convention that was asked for, or that the columns' names tell."""
    columns = angle_columns(given)
    by_name = _named_convention(given)
    if wanted is None and by_name is None:
        raise UsageError(
            "what yaw, pitch and roll mean is not known",
            where=given.table.path,
            expected="columns such as GimbalYawDegree (gimbal), or a table as Metashape or Pix4D "
            "write it",
            fix="--angles gimbal if pitch is -90 where a camera looks straight down, --angles "
            "airframe if it is 0 there; pitch is "
            f"{np.nanmedian(given.table.numbers('pitch', empty=True)):.6g} in the median",
        )
    if wanted is not None and (wanted == "omega-phi-kappa") != (columns == _OMEGA):
        raise UsageError(
            f"--angles {wanted} does not go with the columns {', '.join(columns)}",
            where=given.table.path,
        )
    return wanted or by_name or "gimbal"


def _named_convention(given: PoseTable) -> Convention | None:
    if angle_columns(given) == _OMEGA:
        return "omega-phi-kappa"
    if "gimbal" in given.header["yaw"].casefold():
        return "gimbal"
    title = given.header["image"].casefold()
    return "airframe" if title in ("label", "imagename") else None


def _degrees(given: PoseTable, rows: list[int], convention: Convention, unit: str | None) -> Floats:
    columns = angle_columns(given)
    values = np.column_stack([given.numbers(column, rows, 1e4) for column in columns])
    if unit == "radians":
        _check_radians(given, values)
        return np.degrees(values)
    if given.in_radians(columns):
        raise BenchmarkError(
            f"{', '.join(given.header[c] for c in columns)} say that they are in radians",
            where=given.table.path,
            fix="--angle-unit radians, or name the columns by their unit",
        )
    if unit is None and (np.abs(values) > _TURN_DEG).any():
        raise BenchmarkError(
            f"{', '.join(given.header[c] for c in columns)} go to {np.abs(values).max():.6g}: they "
            "look like gon, of which a turn has 400",
            where=given.table.path,
            expected="degrees, at most 360",
            fix="multiply gon by 0.9; --angle-unit degrees if they are degrees",
        )
    if unit is None and _look_like_radians(values, convention):
        low, high = values.min(), values.max()
        raise BenchmarkError(
            f"all of {', '.join(given.header[c] for c in columns)} are within {low:.4g} and "
            f"{high:.4g}: they look like radians",
            where=given.table.path,
            expected="degrees",
            fix="--angle-unit radians, or --angle-unit degrees if they are",
        )
    return values


def _check_radians(given: PoseTable, values: Floats) -> None:
    most = float(np.abs(values).max())
    if most > 2.0 * math.pi:
        names = ", ".join(given.header[column] for column in angle_columns(given))
        raise BenchmarkError(
            f"{names} reach {most:.6g}, which is no angle in radians",
            where=given.table.path,
            expected="radians, at most 2 pi (6.283) in size",
            fix="leave out --angle-unit radians if they are degrees",
        )


def _look_like_radians(values: Floats, convention: Convention) -> bool:
    """Whether angles of a survey in degrees would hardly be so small."""
    if (np.abs(values) > 2.0 * math.pi).any():
        return False
    if convention == "gimbal":
        return bool(np.abs(values[:, 1]).max() > 0.5)  # a camera 0.5 to 6 degrees off the horizon
    heading = values[:, 2] if convention == "omega-phi-kappa" else values[:, 0]
    return bool(np.abs(heading).max() > 1.0)


def _check_down(rotations: Floats, degrees: Floats, convention: str, path: Path) -> None:
    """Refuse what turns most cameras away from the ground, where the convention is by names only.

    Gimbal angles of photos straight down, read as airframe, look back at the horizon.
    """
    away = -rotations[:, 2, 2] < math.cos(math.radians(_MOST_OFF_NADIR_DEG))
    if away.mean() > _MOST_AWAY:
        raise BenchmarkError(
            f"read as {convention}, {counted(int(away.sum()), 'camera')} of {len(away)} look more "
            f"than {_MOST_OFF_NADIR_DEG:g} degrees away from straight down; the second angle is "
            f"{np.median(degrees[:, 1]):.6g} degrees in the median",
            where=path,
            expected="photos of the ground: gimbal pitch is -90 straight down, airframe pitch 0",
            fix="name the convention with --angles gimbal, airframe or omega-phi-kappa",
        )


def _check_pitch(given: PoseTable, degrees: Floats, convention: str) -> None:
    """Refuse oblique photos that look at the ground as gimbal and as airframe, forwards or back."""
    pitch = float(np.median(degrees[:, 1]))
    if convention == "airframe" and pitch < _OBLIQUE_DEG:
        raise UsageError(
            f"pitch is {pitch:.6g} degrees in the median, which can be read in two ways: as "
            f"airframe, cameras look back, {-pitch:.6g} degrees off straight down; as gimbal, they "
            f"look ahead, {-pitch:.6g} degrees below the horizon",
            where=given.table.path,
            expected=f"photos that look ahead or down, where only the column "
            f"{given.header['image']!r} tells what angles mean",
            fix="name the convention with --angles gimbal or --angles airframe",
        )
