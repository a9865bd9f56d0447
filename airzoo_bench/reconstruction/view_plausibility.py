"""What cameras of a prediction may be instead: of another resolution, or camera-to-world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from airzoo_bench.reconstruction.alignment.camera_sets import PosedCameras
from airzoo_bench.reconstruction.alignment.similarity import fit_many
from airzoo_bench.reconstruction.motions import angle_deg, relative_poses

__all__ = [
    "refuse_camera_to_world",
    "refuse_other_resolution",
    "suspect_camera_to_world",
    "suspect_image_size",
    "suspect_names",
]

_SAME_RATIO = 0.1
_RESOLUTION_RATIO = 1.5
# Where all cameras agree, less is clear: photos of 640 px and maps of 504 px have this ratio.
_SAME_RATIO_OF_ALL = 0.03
_RESOLUTION_RATIO_OF_ALL = 1.1
_LEAST_SHIFT_PX = 1.0  # more than half a pixel, by which conventions differ
_OFF_CENTRE = 0.25
_SMALLEST = 4
_ASPECT_TOLERANCE = 0.05
_MOST_CAMERAS = 64
_CLEARLY_OFF_DEG = 5.0
_CLEARLY_BETTER = 0.5
_OPENGL = np.diag((1.0, -1.0, -1.0))
# Refused where this many cameras say so, this far off; of fewer, or on a line, it is suspected.
_LEAST_CAMERAS, _FAR_DEG, _LINE_SHARE = 5, 20.0, 0.05
# Of the distance between photos that is usual, and of a misfit that another reading may explain.
_CLEAR_SHIFT, _SUGGESTS, _EXPLAINS = 0.2, 0.5, 0.9
_ENOUGH_CAMERAS = 10  # of fewer, bad ones may suggest it by chance


def refuse_other_resolution(
    cameras: Cameras, names: list[str] | None, where: str
) -> tuple[str, ...]:
    """Refuse intrinsics of images of another size than the maps, which the cameras have."""
    size = np.stack((cameras.width, cameras.height), axis=-1)
    ratio = cameras.principal_point / (size / 2.0)
    normalised = (np.abs(cameras.principal_point) <= 1.0).all(axis=1) & (size > _SMALLEST).all(
        axis=1
    )
    shift = np.abs(cameras.principal_point - size / 2.0)
    other = _scaled_alike(ratio, shift) | normalised
    labels = names or [f"camera {row}" for row in range(len(cameras))]
    if other.any():
        rows = np.flatnonzero(other)
        typical = float(np.median(ratio[rows].mean(axis=1)))
        width, height = (round(typical * side) for side in size[0].tolist())
        likely = f"of images of about {width} x {height}"
        likely = "normalised to 0..1" if normalised.any() else likely
        raise PredictionError(
            f"the principal point is {typical:.3g} times the centre of the maps in "
            f"{first_of([labels[row] for row in rows.tolist()], len(cameras))}: the intrinsics "
            f"look {likely}",
            where=where,
            expected=f"intrinsics of the maps' own size, {size[0, 0]} x {size[0, 1]}",
            fix="scale fx, cx by the ratio of widths and fy, cy by the ratio of heights",
        )
    off = np.flatnonzero((np.abs(ratio - 1.0) > 2.0 * _OFF_CENTRE).any(axis=1)).tolist()
    if not off:
        return ()
    listed = first_of([labels[row] for row in off], len(cameras))
    return (f"the principal point is far from the centre of the maps in {listed}",)


def suspect_image_size(size: tuple[int, int], true_width: int, true_height: int) -> str | None:
    """Say where maps (width, height) have another shape than the photos that they belong to."""
    change = (size[0] / size[1]) / (true_width / true_height)
    if abs(np.log(change)) <= _ASPECT_TOLERANCE:
        return None
    turned = abs(np.log(change * (true_width / true_height) ** 2)) <= _ASPECT_TOLERANCE
    reason = "turned by 90 degrees (EXIF?)" if turned else "cut, padded, or of other photos"
    return (
        f"maps of {size[0]} x {size[1]} for photos of {true_width} x {true_height}: the images "
        f"look {reason}"
    )


def suspect_camera_to_world(given: Poses, truth: Poses) -> str | None:
    """Say where poses look camera-to-world, read as world-to-camera, or the reverse."""
    found = _inversion(given, truth)
    if found is None or found.as_given <= _CLEARLY_OFF_DEG:
        return None
    return str(found) if found.inverted < _CLEARLY_BETTER * found.as_given else None


def suspect_names(given: PosedCameras, truth: PosedCameras, where: str) -> str | None:
    """Say where photos named one off explain half of the misfit of centres, refuse nine tenths."""
    names = sorted(truth.names)
    true = truth.centres[np.argsort(truth.names)]
    at = np.searchsorted(names, given.names)
    spacing = float(np.median(np.linalg.norm(np.diff(true, axis=0), axis=1))) if len(at) else 0.0
    best = 0.0, ""
    for aligned in (False, True):
        here, *others = (_misfit(given.centres, true, at + step, aligned) for step in (0, 1, -1))
        if _CLEAR_SHIFT * spacing < here < np.inf:
            which = "next" if others[0] < others[1] else "previous"
            gone = 1.0 - min(others) / here
            said = f"centres are {here:.3g} m from the photos they are named for, and {gone:.0%} "
            best = max(best, (gone, f"{said}nearer to the {which} ones in the order of names"))
    if best[0] > _EXPLAINS:
        raise PredictionError(
            f"names of photos look one off: {best[1]}",
            where=where,
            expected="each camera under the name of its own photo",
            fix="look where the list of names begins: at the first photo, as the views do",
        )
    suggested = best[0] > _SUGGESTS and len(at) >= _ENOUGH_CAMERAS
    return f"are the photos named one off? Their {best[1]}" if suggested else None


def _misfit(centres: Floats, true: Floats, rows: Ints, aligned: bool) -> float:
    """Return the median distance of centres (N, 3) to rows of the truth, infinite for too few."""
    there = (rows >= 0) & (rows < len(true)) & np.isfinite(centres).all(axis=1)
    source, target = centres[there], true[rows[there]]
    if len(source) < _LEAST_CAMERAS:
        return float("inf")
    if aligned:
        source = fit_many(source[None], target[None], with_scale=True)[0][0].apply(source)
    return float(np.median(np.linalg.norm(source - target, axis=1)))


def refuse_camera_to_world(given: Poses, truth: Poses, where: str) -> None:
    """Refuse poses that fit the truth only once they are inverted; see `suspect_camera_to_world`.

    They are more than 20 degrees off as given, and less than that, and than a third of it, once
    inverted. Five cameras or more must say so which do not lie on a line: along one, names in
    reverse order look the same.

    Raises
    ------
    PredictionError
        States both angles.
    """
    found = _inversion(given, truth)
    if found is None or len(given) < _LEAST_CAMERAS or _on_a_line(truth.centres):
        return
    if found.as_given > _FAR_DEG > found.inverted and found.inverted * 3.0 < found.as_given:
        raise PredictionError(
            str(found),
            where=where,
            expected="extrinsics that take points of the world to the camera, x_cam = R X + t, or "
            "what the reader says that they are",
            fix="invert them: R.T and -R.T @ t"
            + (", both with diag(1, -1, -1) from the left" if found.axes else ""),
        )


@dataclass(frozen=True)
class _Inversion:
    """Degrees between poses and the truth, as given and once inverted."""

    as_given: float
    inverted: float
    axes: str

    def __str__(self) -> str:
        return (
            "the extrinsics look inverted (camera-to-world for world-to-camera, or the reverse): "
            f"between two cameras they are {self.as_given:.1f} degrees off the truth as they "
            f"stand, {self.inverted:.1f} once inverted{self.axes}"
        )


def _inversion(given: Poses, truth: Poses) -> _Inversion | None:
    rows = np.unique(np.linspace(0, len(given) - 1, _MOST_CAMERAS).astype(int))
    if len(given) < 3:
        return None
    chosen, true = given.take(rows), truth.take(rows)
    inverse = Poses.from_centres(np.swapaxes(chosen.rotation, 1, 2), chosen.translation)
    opengl = Poses.from_centres(_OPENGL @ inverse.rotation, inverse.centres)
    as_given = _median_angle(chosen, true)
    readings = ((inverse, ""), (opengl, " and in OpenCV's axes, not OpenGL's"))
    found = [_Inversion(as_given, _median_angle(one, true), axes) for one, axes in readings]
    return min(found, key=lambda one: one.inverted)


def _on_a_line(centres: Floats) -> bool:
    spread = np.linalg.svd(centres - centres.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= _LINE_SHARE * spread[0])


def _scaled_alike(ratio: Floats, shift: Floats) -> Bools:
    """Whether x and y are off by the same clear factor, (N,)."""
    positive = np.asarray((ratio > 0.0).all(axis=1))
    logs = np.log(np.where(positive[:, None], ratio, 1.0))
    apart, factor = np.abs(logs[:, 0] - logs[:, 1]), np.abs(logs).min(axis=1)
    clear = (apart <= _SAME_RATIO) & (factor > np.log(_RESOLUTION_RATIO))
    slight = (apart <= _SAME_RATIO_OF_ALL) & (factor > np.log(_RESOLUTION_RATIO_OF_ALL))
    slight &= shift.min(axis=1) > _LEAST_SHIFT_PX
    return np.asarray(positive & (clear | slight.all()))


def _median_angle(poses: Poses, truth: Poses) -> float:
    first, second = np.triu_indices(len(poses), 1)
    (turn, sight), (true_turn, true_sight) = (
        relative_poses(one, first, second) for one in (poses, truth)
    )
    worse = np.maximum(rotation_angle_deg(turn, true_turn), angle_deg(sight, true_sight))
    return float(np.median(worse))
