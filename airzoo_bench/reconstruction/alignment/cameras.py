"""Bringing a prediction into the frame of the truth by its cameras, partners by image name."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from airzoo_bench.core.errors import first_of
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import rotation_angle_deg
from airzoo_bench.reconstruction.alignment.consensus import (
    LEAST_CAMERAS,
    PosedCameras,
    RansacSettings,
    distances,
    fit_cameras,
)
from airzoo_bench.reconstruction.alignment.icp import IcpReport
from airzoo_bench.reconstruction.alignment.similarity import AlignmentError, Similarity

__all__ = [
    "Alignment",
    "Method",
    "Residuals",
    "align",
    "partners",
    "refined",
]

Method = Literal["none", "sim3", "sim3+icp"]


@dataclass(frozen=True)
class Residuals:
    """What is left between partners: root mean square, median and largest."""

    rms: float
    median: float
    largest: float


@dataclass(frozen=True, eq=False)
class Alignment:
    """A transform into the frame of the truth, and how well it fits.

    Attributes
    ----------
    method : str
    transform : Similarity
    cameras : int
        That have a partner; so many of the truth have none: `missing`.
    missing : int
    inliers : int
        Cameras within the limit, to which the transform is fitted.
    inlier_limit : float or None
        None where nothing was fitted.
    used_orientations : bool
        The centres lie on a line: the rotation is the mean of the orientations' differences.
    robust : bool
        False where fewer than 3 cameras agreed, so that all of them were fitted.
    centres, inlier_centres : Residuals or None
        Distances of all partners' centres, and of the inliers', in units of the truth.
    rotations_deg : Residuals or None
        Angles between all partners' orientations, where both have them.
    icp : IcpReport or None
    icp_failure : str or None
        Why ICP changed nothing.
    inlier_names : tuple of str
        Of the cameras that the transform is fitted to.
    """

    method: Method
    transform: Similarity
    cameras: int = 0
    missing: int = 0
    inliers: int = 0
    inlier_limit: float | None = None
    used_orientations: bool = False
    robust: bool = True
    centres: Residuals | None = None
    inlier_centres: Residuals | None = None
    rotations_deg: Residuals | None = None
    icp: IcpReport | None = None
    icp_failure: str | None = None
    inlier_names: tuple[str, ...] = ()


def align(
    method: Method,
    predicted: PosedCameras | None,
    truth: PosedCameras | None,
    *,
    ransac: RansacSettings | None,
) -> Alignment:
    """Find the transform of a prediction into the frame of the truth, by cameras.

    Parameters
    ----------
    method : {"none", "sim3", "sim3+icp"}
    predicted, truth : PosedCameras or None
        With ``none`` they may be left out; given, their residuals are stated.
        ``sim3+icp`` is aligned as ``sim3`` here; see `refined`.
    ransac : RansacSettings or None
        Not None unless the method is ``none``.

    Returns
    -------
    Alignment

    Raises
    ------
    AlignmentError
        A camera that the truth lacks, fewer than 3 partners, centres all at a point, or on a line
        without orientations.
    ValueError
        Settings or cameras that the method needs are None.
    """
    if method == "none":
        return _with_residuals(Alignment("none", Similarity.identity()), predicted, truth)
    if ransac is None or predicted is None or truth is None:
        raise ValueError(f"{method} needs cameras and the settings of RANSAC")
    rows, true_rows = partners(predicted, truth)
    source, target = predicted.take(rows), truth.take(true_rows)
    _require_cameras(len(rows), len(predicted.names))
    fit = fit_cameras(source, target, ransac)
    found = Alignment(
        method=method,
        transform=fit.transform,
        inliers=int(fit.inliers.sum()),
        inlier_limit=fit.limit,
        used_orientations=fit.used_orientations,
        robust=fit.robust,
        inlier_names=target.take(np.flatnonzero(fit.inliers)).names,
    )
    return _with_residuals(found, predicted, truth)


def refined(
    found: Alignment,
    step: Similarity,
    report: IcpReport,
    predicted: PosedCameras,
    truth: PosedCameras,
) -> Alignment:
    """Return an alignment after which `step` is done, ICP's, in the frame of the truth."""
    moved = replace(found, transform=step.after(found.transform), icp=report)
    return _with_residuals(moved, predicted, truth)


def partners(predicted: PosedCameras, truth: PosedCameras) -> tuple[Ints, Ints]:
    """Find the rows of cameras of the same name.

    Parameters
    ----------
    predicted, truth : PosedCameras

    Returns
    -------
    rows, true_rows : (P,) int64 arrays
        In the order of the truth. Cameras whose centre is not finite have no partner.

    Raises
    ------
    AlignmentError
        A name comes twice, or the truth lacks it.
    """
    for cameras, whose in ((predicted, "prediction"), (truth, "truth")):
        _refuse_repeats(cameras.names, whose)
    place = {name: row for row, name in enumerate(predicted.names)}
    unknown = sorted(set(place) - set(truth.names))
    if unknown:
        raise AlignmentError(
            f"the truth lacks the images {first_of(unknown, len(place))}",
            expected=f"names such as {first_of(truth.names)}",
            fix="name the cameras as the images of the scene are named, and leave out others",
        )
    placed, known = _placed(predicted), _placed(truth)
    pairs = [(place[name], row) for row, name in enumerate(truth.names) if name in place]
    rows, true_rows = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    kept = placed[rows] & known[true_rows]
    return rows[kept], true_rows[kept]


def _placed(cameras: PosedCameras) -> Bools:
    return np.asarray(np.isfinite(cameras.centres).all(axis=1))


def _with_residuals(
    found: Alignment, predicted: PosedCameras | None, truth: PosedCameras | None
) -> Alignment:
    if predicted is None or truth is None:
        return found
    rows, true_rows = partners(predicted, truth)
    source, target = predicted.take(rows), truth.take(true_rows)
    away = distances(found.transform.apply(source.centres), target.centres)
    angles = None
    if source.rotation is not None and target.rotation is not None:
        aligned = source.rotation @ found.transform.rotation.T
        angles = _residuals(rotation_angle_deg(aligned, target.rotation))
    inliers = np.isin(target.names, found.inlier_names)
    return replace(
        found,
        cameras=len(rows),
        missing=len(truth.names) - len(rows),
        centres=_residuals(away),
        inlier_centres=_residuals(away[inliers]),
        rotations_deg=angles,
    )


def _residuals(values: Floats) -> Residuals | None:
    if not len(values):
        return None
    rms = float(np.sqrt((values * values).mean()))
    return Residuals(rms, float(np.median(values)), float(values.max()))


def _refuse_repeats(names: tuple[str, ...], whose: str) -> None:
    repeated = sorted(name for name, times in Counter(names).items() if times > 1)
    if repeated:
        raise AlignmentError(
            f"images come twice in the {whose}: {first_of(repeated)}",
            expected="each image once",
        )


def _require_cameras(count: int, predicted: int) -> None:
    if count < LEAST_CAMERAS:
        raise AlignmentError(
            f"a similarity needs {LEAST_CAMERAS} cameras, and {count} of {predicted} predicted "
            "ones have a position and a partner in the truth",
            expected=f"at least {LEAST_CAMERAS} cameras",
            fix="give poses of more images, or predict in the truth's frame and align by 'none'",
        )
