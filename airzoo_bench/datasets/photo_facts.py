"""What photos say of themselves, held against their poses: heights, GPS, priors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, poses_of
from airzoo_bench.benchmark.scene_inputs import SceneInputs
from airzoo_bench.datasets.dji import PhotoPrior
from airzoo_bench.datasets.prior_errors import Turned, prior_errors, turned_priors
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.blocks import blocked_heights
from airzoo_bench.geometry.frames import from_lonlat
from airzoo_bench.geometry.rays import nearest_heights

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "OUTLIER_M",
    "Cameras3D",
    "GpsFacts",
    "PriorFacts",
    "WithoutPrior",
    "camera_facts",
    "gps_facts",
    "median",
    "prior_facts",
    "without_prior",
]

_NEAREST_OF_PX = 1_000_000
OUTLIER_M = 25.0
"""Receivers are rarely so far off, and photos often so far from each other."""
_OUTLIER = 10.0


@dataclass(frozen=True, eq=False)
class Cameras3D:
    """Cameras over the surface model.

    Attributes
    ----------
    heights_m : (N,) array
        Of each camera above the surface below it, or the nearest height there is; NaN where there
        is none.
    surface_m : (N,) array
        The height of that surface.
    relative_m : (N,) array
        Above the place of take-off by the photo's own word; NaN where it has none.
    """

    heights_m: Floats
    surface_m: Floats
    relative_m: Floats

    @property
    def height_m(self) -> float:
        """Median height above the surface."""
        return median(self.heights_m)

    @property
    def relative_height_m(self) -> float:
        """Median height above take-off; NaN where no photo has one."""
        return median(self.relative_m)

    @property
    def below(self) -> int:
        """Cameras on the surface or below."""
        return int((self.heights_m <= 0.0).sum())


@dataclass(frozen=True)
class GpsFacts:
    """Poses against the photos' own GPS.

    Attributes
    ----------
    photos : int
        Photos that have a position.
    distance_m, height_m : float
        Median horizontal distance, and median of pose less GPS in height (NaN without altitudes).
    offset_m : tuple of float
        Median of pose less GPS, east and north.
    apart : dict of str to float
        Ids of photos whose pose is far from GPS (plan and height) though the median's is not,
        and how far; the median offset is taken off.
    """

    photos: int
    distance_m: float
    height_m: float
    offset_m: tuple[float, float]
    apart: dict[str, float]


@dataclass(frozen=True)
class PriorFacts:
    """Median errors of the priors, and the mistakes that explain large ones."""

    photos: int
    position_m: float
    yaw_deg: float
    pitch_deg: float
    rotation_deg: float
    turned: tuple[tuple[str, tuple[str, ...]], ...]


@dataclass(frozen=True)
class WithoutPrior:
    """Photos that have no prior.

    Attributes
    ----------
    photos : int
        All of the scene.
    lacking : dict of str to tuple of str
        Their ids by what they lack: the first of position, altitude, gimbal angles.
    some_word : bool
        Whether any photo of the scene says something of its position or angles.
    """

    photos: int
    lacking: dict[str, tuple[str, ...]]
    some_word: bool

    @property
    def count(self) -> int:
        """How many have none."""
        return sum(map(len, self.lacking.values()))


def camera_facts(photos: pd.DataFrame, dsm: Path, metadata: Mapping[str, PhotoPrior]) -> Cameras3D:
    """Measure how high cameras are above the surface model.

    Parameters
    ----------
    photos : DataFrame
        As `scene_inputs.photo_table` makes it.
    dsm : Path
    metadata : mapping of str to PhotoPrior
        By file name; photos without an entry have none.
    """
    centres = poses_of(photos).centres
    with blocked_heights(dsm) as field:
        found = field.sample(centres[:, :2])
        gap = np.isnan(found)
        if gap.any():
            found[gap] = nearest_heights(field, _NEAREST_OF_PX)(centres[gap, :2])
    relative = [_known(metadata.get(name), "relative_altitude_m") for name in photos["image"]]
    return Cameras3D(centres[:, 2] - found, found, np.array(relative, dtype=np.float64))


def gps_facts(inputs: SceneInputs, metadata: Mapping[str, PhotoPrior]) -> GpsFacts | None:
    """Hold poses against the photos' own GPS; None where no photo has a position."""
    rows = [metadata.get(name) for name in inputs.photos["image"]]
    placed = np.array([_known(row, "lon") is not None for row in rows], dtype=bool)
    if not placed.any():
        return None
    lonlat = np.array([[_known(row, "lon"), _known(row, "lat")] for row in rows], np.float64)
    apart = poses_of(inputs.photos).centres.copy()
    apart[:, :2] -= from_lonlat(inputs.crs, lonlat)
    apart[:, 2] -= np.array([_known(row, "altitude_m") for row in rows], np.float64)
    middle = np.array([median(apart[placed, axis]) for axis in range(3)])
    away = np.linalg.norm(np.nan_to_num(apart - middle), axis=1)
    far = placed & (away > OUTLIER_M) & (away > _OUTLIER * median(away[placed]))
    return GpsFacts(
        int(placed.sum()),
        median(np.hypot(apart[placed, 0], apart[placed, 1])),
        float(middle[2]),
        (float(middle[0]), float(middle[1])),
        dict(zip(inputs.photos["id"][far], away[far].tolist(), strict=True)),
    )


def without_prior(photos: pd.DataFrame, metadata: Mapping[str, PhotoPrior]) -> WithoutPrior:
    """Find the photos that have no prior, and what each of them lacks."""
    lacking: dict[str, tuple[str, ...]] = {}
    said = [metadata.get(name) for name in photos["image"]]
    for one, prior, there in zip(photos["id"], said, _with_prior(photos), strict=True):
        if not there:
            what = _first_lacking(prior)
            lacking[what] = (*lacking.get(what, ()), one)
    words = [_known(prior, name) for prior in said for name in ("lon", "yaw_deg")]
    return WithoutPrior(len(photos), lacking, any(word is not None for word in words))


def _first_lacking(prior: PhotoPrior | None) -> str:
    if _known(prior, "lon") is None:
        return "GPS position"
    return "altitude" if _known(prior, "altitude_m") is None else "gimbal angles"


def prior_facts(photos: pd.DataFrame) -> PriorFacts | None:
    """Hold priors against poses; None where no photo has a prior."""
    there = photos[_with_prior(photos)]
    if there.empty:
        return None
    priors, poses = poses_of(there, PRIOR_COLUMNS), poses_of(there)
    errors = prior_errors(priors, poses)
    return PriorFacts(
        len(there),
        median(errors.position_m),
        median(errors.yaw_deg),
        median(errors.pitch_deg),
        median(errors.rotation_deg),
        tuple((one.what, _ids(there, one)) for one in turned_priors(priors, poses)),
    )


def _with_prior(photos: pd.DataFrame) -> Bools:
    if not set(PRIOR_COLUMNS) <= set(photos.columns):
        return np.zeros(len(photos), dtype=bool)
    whole: Bools = np.isfinite(photos[list(PRIOR_COLUMNS)].to_numpy(np.float64)).all(axis=1)
    return whole


def _ids(photos: pd.DataFrame, turned: Turned) -> tuple[str, ...]:
    return tuple(photos["id"][turned.rows])


def _known(prior: PhotoPrior | None, name: str) -> float | None:
    return None if prior is None else getattr(prior, name)


def median(values: Floats) -> float:
    """Median of the finite values; NaN where there are none."""
    there = values[np.isfinite(values)]
    return float(np.median(there)) if there.size else math.nan
