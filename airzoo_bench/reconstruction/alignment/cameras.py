"""Bringing a prediction into the frame of the truth by its cameras, partners by image name."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.poses import rotation_angle_deg
from airzoo_bench.reconstruction.alignment.camera_sets import (
    LEAST_CAMERAS,
    PosedCameras,
    RansacSettings,
    distances,
)
from airzoo_bench.reconstruction.alignment.consensus import fit_cameras
from airzoo_bench.reconstruction.alignment.icp import IcpReport
from airzoo_bench.reconstruction.alignment.similarity import AlignmentError, Similarity

__all__ = ["Alignment", "Residuals", "align", "alignment_values", "partners", "with_step"]

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
    cameras, missing : int
        Cameras of the truth that have a partner, and those that have none.
    inliers : int
        Cameras within the limit, to which the transform is fitted: `inlier_names`.
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
    icp_failure : str or None
        Why ICP changed nothing.
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
    method: Method, predicted: PosedCameras | None, truth: PosedCameras, ransac: RansacSettings
) -> Alignment:
    """Find the transform of a prediction into the frame of the truth, by cameras."""
    if method == "none" or predicted is None:
        found = Alignment("none", Similarity.identity())
        return found if predicted is None else _with_residuals(found, predicted, truth)
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


def with_step(
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
    """Find the rows of cameras of the same name, which none has twice, in the order of the truth.

    Cameras whose centre is not finite have no partner.

    Returns
    -------
    rows, true_rows : (P,) int64 arrays
    """
    place = {name: row for row, name in enumerate(predicted.names)}
    pairs = [(place[name], row) for row, name in enumerate(truth.names) if name in place]
    rows, true_rows = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    both = predicted.centres[rows], truth.centres[true_rows]
    kept = np.isfinite(np.concatenate(both, axis=1)).all(axis=1)
    return rows[kept], true_rows[kept]


def _with_residuals(found: Alignment, predicted: PosedCameras, truth: PosedCameras) -> Alignment:
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


def _require_cameras(count: int, predicted: int) -> None:
    if count < LEAST_CAMERAS:
        raise AlignmentError(
            f"a similarity needs {LEAST_CAMERAS} cameras, and {count} of {predicted} predicted "
            "ones have a position and a partner in the truth",
            expected=f"at least {LEAST_CAMERAS} cameras",
            fix="give poses of more images, or predict in the truth's frame and align by 'none'",
        )


def alignment_values(found: Alignment) -> dict[str, Any]:
    """Return what ``alignment.json`` says: how a scene was aligned, its scale, its residuals."""
    values: dict[str, Any] = {
        "method": found.method,
        "scale": found.transform.scale,
        "matrix": found.transform.matrix.tolist(),
        "cameras": found.cameras,
        "cameras_missing": found.missing,
        "inliers": found.inliers,
        "inlier_names": list(found.inlier_names),
        "inlier_limit_m": found.inlier_limit,
        "used_orientations": found.used_orientations,
        "robust": found.robust,
    }
    for name in ("centres", "inlier_centres", "rotations_deg"):
        residuals: Residuals | None = getattr(found, name)
        values[name] = None if residuals is None else _finite(asdict(residuals))
    values["icp"] = None if found.icp is None else _finite(asdict(found.icp))
    values["icp_failure"] = found.icp_failure
    return values


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """Write infinite numbers as text, as in results, at whatever depth."""
    return {
        key: _finite(one) if isinstance(one, dict) else "Infinity" if one == np.inf else one
        for key, one in values.items()
    }
