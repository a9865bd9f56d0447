"""Lenses and a sparse model, as structure from motion has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses

__all__ = [
    "Colours",
    "Lens",
    "Model",
    "assumed_lenses",
    "empty_model",
    "known_lenses",
    "model_arrays",
    "model_from_arrays",
]

Colours = NDArray[np.uint8]

# Where nothing is known of a lens: a field of view of about 45 degrees, COLMAP's guess.
_FOCAL_PER_SIDE = 1.2
_CAMERA_KEYS = ("width", "height", "focal", "principal_point", "distortion")


class Lens(NamedTuple):
    """A camera as COLMAP has it.

    Attributes
    ----------
    model : str
    width, height : int
    params : tuple of float
    known : bool
        Kept as it is; otherwise distortion is estimated,
    focal_known : bool
        and the focal length too where it is not known.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]
    known: bool
    focal_known: bool


@dataclass(frozen=True, eq=False)
class Model:
    """A sparse reconstruction, in whatever frame.

    Attributes
    ----------
    rows : (R,) int64 array
        Of the photos that were placed, ascending.
    cameras, poses : Cameras, Poses
        Of these.
    points : (P, 3) array
    colours : (P, 3) uint8 array
        Mean over the features that a point was made from.
    reprojection_px : float
        Mean error; NaN where there are no points.
    """

    rows: Ints
    cameras: Cameras
    poses: Poses
    points: Floats
    colours: Colours
    reprojection_px: float


def known_lenses(cameras: Cameras) -> list[Lens]:
    """Return cameras as COLMAP has them, with all coefficients of the lens."""
    rows = np.hstack((cameras.focal, cameras.principal_point, cameras.distortion))
    return [
        # FULL_OPENCV: k1 k2 p1 p2 k3, and a denominator of 1.
        Lens("FULL_OPENCV", int(w), int(h), (*map(float, row), 0.0, 0.0, 0.0), True, True)
        for w, h, row in zip(cameras.width, cameras.height, rows, strict=True)
    ]


def assumed_lenses(sizes: Ints, focal_px: Floats) -> list[Lens]:
    """Return a first guess of photos' lenses, with one coefficient of distortion.

    Parameters
    ----------
    sizes : (N, 2) int64 array
        Width and height.
    focal_px : (N,) array
        What the photos say of themselves, which is kept: straight down at flat ground nothing
        tells a longer focal length from a greater height. NaN where they say nothing. Photos of
        one size and focal length share a lens.
    """
    rough = _FOCAL_PER_SIDE * sizes.max(axis=1)
    guesses = np.where(np.isfinite(focal_px), focal_px, rough)
    return [
        Lens("SIMPLE_RADIAL", w, h, (float(f), w / 2, h / 2, 0.0), False, bool(given))
        for (w, h), f, given in zip(sizes.tolist(), guesses, np.isfinite(focal_px), strict=True)
    ]


def empty_model() -> Model:
    """Return the model of no photos."""
    return Model(
        rows=np.zeros(0, np.int64),
        cameras=Cameras.from_matrices(np.zeros((0, 3, 3)), 1, 1),
        poses=Poses(rotation=np.zeros((0, 3, 3)), centres=np.zeros((0, 3))),
        points=np.zeros((0, 3)),
        colours=np.zeros((0, 3), np.uint8),
        reprojection_px=np.nan,
    )


def model_arrays(model: Model) -> dict[str, NDArray[np.generic]]:
    """Return a model as arrays by name, for a file."""
    lenses = {key: getattr(model.cameras, key) for key in _CAMERA_KEYS}
    plain = {key: getattr(model, key) for key in ("rows", "points", "colours")}
    poses = {"rotation": model.poses.rotation, "centres": model.poses.centres}
    return {**lenses, **plain, **poses, "reprojection_px": np.array(model.reprojection_px)}


def model_from_arrays(arrays: dict[str, Any]) -> Model:
    """Return the model that `model_arrays` took apart."""
    return Model(
        rows=arrays["rows"],
        cameras=Cameras(**{key: arrays[key] for key in _CAMERA_KEYS}),
        poses=Poses(rotation=arrays["rotation"], centres=arrays["centres"]),
        points=arrays["points"],
        colours=arrays["colours"],
        reprojection_px=float(arrays["reprojection_px"]),
    )
