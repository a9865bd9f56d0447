"""Bringing cameras into the frame of the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.api.arrays import coordinates, finite, floats, positive, refused, whole
from airzoo_bench.api.labels import same_columns, same_index
from airzoo_bench.api.pose_arrays import are_centres, pose_rows
from airzoo_bench.core.errors import ArgumentError
from airzoo_bench.core.shown import Shown, number
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.poses import FARTHEST
from airzoo_bench.reconstruction.alignment import (
    LEAST_CAMERAS,
    PosedCameras,
    RansacSettings,
    fit_cameras,
)
from airzoo_bench.reconstruction.similarity import Similarity, umeyama

__all__ = ["CameraAlignment", "align_cameras"]


@dataclass(frozen=True, eq=False, repr=False)
class CameraAlignment(Shown):
    """The similarity y = scale * rotation x + translation from a prediction to the truth.

    Attributes
    ----------
    transform : Similarity
    inliers : (N,) bool
        Cameras to which it is fitted.
    residuals : (N,) float64
        Distances of the moved centres from the true ones, infinite for cameras without a pose.
    used_orientations : bool
        The centres lie on a line: orientations gave the turn about it.
    """

    transform: Similarity
    inliers: Bools
    residuals: Floats
    used_orientations: bool

    @property
    def scale(self) -> float:
        """The scale, above 0."""
        return self.transform.scale

    @property
    def rotation(self) -> Floats:
        """The rotation, (3, 3)."""
        return self.transform.rotation

    @property
    def matrix(self) -> Floats:
        """The transform as a (4, 4) matrix, scale times rotation next to the translation."""
        return self.transform.matrix

    def apply(self, points: ArrayLike) -> Floats:
        """Move points (N, 3) into the frame of the truth.

        Parameters
        ----------
        points : (N, 3) array-like
            In the frame of the prediction.

        Returns
        -------
        (N, 3) float64 array
            In the frame of the truth.
        """
        return self.transform.apply(floats("points", points, (None, 3)))

    def _shown(self) -> Mapping[str, object]:
        inliers = self.residuals[self.inliers]
        return {
            "cameras": len(self.residuals),
            "without_pose": int(np.isinf(self.residuals).sum()),
            "inliers": int(self.inliers.sum()),
            "scale": f"{self.scale:.6g}",
            "rms_of_inliers": number(float(np.sqrt((inliers * inliers).mean()))),
            "used_orientations": self.used_orientations,
        }


def align_cameras(
    predicted: ArrayLike,
    true: ArrayLike,
    *,
    robust: bool = True,
    with_scale: bool = True,
    inlier_m: float = 5.0,
    inlier_deg: float = 10.0,
    seed: int = 0,
) -> CameraAlignment:
    """Find the similarity that brings predicted camera centres to the true ones.

    Parameters
    ----------
    predicted : (N, 3, 4), (N, 4, 4) or (N, 3) array-like
        World-to-camera poses [R | t], or camera centres, in any frame and scale; NaN where there
        is none.
    true : (N, 3, 4), (N, 4, 4) or (N, 3) array-like
        Of the same cameras, in metres.
    robust : bool
        Find outliers by the reconstruction track's RANSAC, 1,000 to 100,000 trials at a confidence
        of 0.9999, and fit to the others; otherwise fit to all, by plain Umeyama.
    with_scale : bool
        Whether to fit the scale, which is 1 otherwise; without it only plain.
    inlier_m, inlier_deg : float
        Inliers are nearer; angles count for centres on a line alone, a straight flight strip,
        where orientations give the turn about it.
    seed : int
        Of RANSAC's samples.

    Returns
    -------
    CameraAlignment
        The transform, inliers and residuals.

    Raises
    ------
    ArgumentError
        Fewer than 3 cameras; centres at one point, or on a line without orientations; arrays that
        do not fit; a truth with NaN.

    References
    ----------
    Umeyama, Least-squares estimation of transformation parameters between two point patterns,
    PAMI 13(4), 1991. Chum, Matas, Kittler, Locally optimized RANSAC, DAGM 2003.

    Examples
    --------
    >>> true = [[0.0, 0, 50], [40, 0, 50], [40, 30, 60], [0, 30, 55], [20, 15, 52]]
    >>> predicted = [[x / 10, y / 10, z / 10] for x, y, z in true]
    >>> predicted[4] = [90.0, 0, 0]  # an outlier
    >>> align_cameras(predicted, true)
    CameraAlignment
      cameras            5
      without_pose       0
      inliers            4
      scale              10
      rms_of_inliers     0.0000
      used_orientations  False
    """
    same_index({"predicted": predicted, "true": true})
    same_columns({"predicted": predicted, "true": true}, may_be_renamed=True)
    given, known = _cameras("predicted", predicted, missing=True), _cameras("true", true)
    if len(given.names) != len(known.names):
        raise ArgumentError(
            f"have {len(given.names)} and {len(known.names)} cameras",
            where="predicted, true",
            expected="the same cameras in the same order, NaN where there is no pose",
        )
    if robust and not with_scale:
        raise ArgumentError(
            "the robust alignment always finds the scale",
            where="with_scale",
            fix="leave it at True, or choose robust=False",
        )
    rows = np.flatnonzero(np.isfinite(given.centres).all(axis=1))
    if len(rows) < LEAST_CAMERAS:
        raise ArgumentError(
            f"has {len(rows)} cameras with a pose",
            where="predicted",
            expected=f"at least {LEAST_CAMERAS}, which a similarity needs",
        )
    source, target = given.take(rows), known.take(rows)
    settings = RansacSettings(
        inlier_limit=positive("inlier_m", inlier_m),
        inlier_limit_deg=positive("inlier_deg", inlier_deg),
        seed=whole("seed", seed, 0),
    )
    inliers = np.zeros(len(known.names), np.bool_)
    with refused("predicted, true"):
        if robust:
            fit = fit_cameras(source, target, settings)
            transform, inliers[rows], turned = fit.transform, fit.inliers, fit.used_orientations
        else:
            transform = umeyama(source.centres, target.centres, with_scale=with_scale)
            inliers[rows], turned = True, False
    residuals = np.full(len(inliers), np.inf)
    offsets = transform.apply(source.centres) - target.centres
    residuals[rows] = np.sqrt((offsets * offsets).sum(axis=1))
    return CameraAlignment(transform, inliers, residuals, turned)


def _cameras(name: str, values: ArrayLike, *, missing: bool = False) -> PosedCameras:
    if not are_centres(name, values):
        _, poses = pose_rows(name, values, missing=missing)
        centres, rotation = poses.centres, poses.rotation
    elif missing:
        centres, rotation = floats(name, values, (None, 3)), None
        finite(name, centres[~np.isnan(centres).all(axis=1)], FARTHEST)
    else:
        centres, rotation = coordinates(name, values), None
    return PosedCameras(tuple(map(str, range(len(centres)))), centres, rotation)
