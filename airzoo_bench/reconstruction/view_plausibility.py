"""What cameras of a prediction may be instead: of another resolution, or camera-to-world."""

from __future__ import annotations

import numpy as np

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rotations import rotation_angle_deg
from airzoo_bench.reconstruction.motions import angle_deg, relative_poses

__all__ = ["refuse_other_resolution", "suspect_camera_to_world", "suspect_image_size"]


_SAME_RATIO = 0.1
_RESOLUTION_RATIO = 1.5
_OFF_CENTRE = 0.25
_SMALLEST = 4
_ASPECT_TOLERANCE = 0.05
_MOST_CAMERAS = 64
_CLEARLY_OFF_DEG = 5.0
_CLEARLY_BETTER = 0.5
_OPENGL = np.diag((1.0, -1.0, -1.0))


def refuse_other_resolution(
    cameras: Cameras, names: list[str] | None, where: str
) -> tuple[str, ...]:
    """Refuse intrinsics of images of another size than the maps, which the cameras have.

    The principal point of a whole image lies near its centre. Where it lies at the same multiple
    of the maps' centre in x and in y, and that is above 1.5 or below 1 / 1.5, the intrinsics are of
    another resolution. Names of the images, file and field (`where`) are for messages.

    Returns
    -------
    tuple of str
        Warnings of principal points that are more than a quarter of the image off its centre
        without such a multiple: of images that were cut, perhaps.

    Raises
    ------
    PredictionError
        Names the first cameras and the ratio.
    """
    size = np.stack((cameras.width, cameras.height), axis=-1)
    ratio = cameras.principal_point / (size / 2.0)
    normalised = (np.abs(cameras.principal_point) <= 1.0).all(axis=1) & (size > _SMALLEST).all(
        axis=1
    )
    other = _scaled_alike(ratio) | normalised
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
    """Say where maps (width, height) have another shape than the photos that they belong to.

    A warning where the ratio of the sides differs by more than 5 %.
    """
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
    """Say where poses that should be world-to-camera look like camera-to-world.

    Compared is what no choice of the world changes: the rotation between two cameras, and the
    direction in which a camera sees another one. The larger of the two angles to the truth is
    taken; its median over pairs is large as given and small once the poses are inverted, with the
    axes of OpenCV or of OpenGL. Of more than 64 cameras, an even sample of 64 is compared; fewer
    than 3 tell nothing.
    """
    rows = np.unique(np.linspace(0, len(given) - 1, _MOST_CAMERAS).astype(int))
    if len(given) < 3:
        return None
    chosen, true = given.take(rows), truth.take(rows)
    inverse = Poses.from_centres(np.swapaxes(chosen.rotation, 1, 2), chosen.translation)
    opengl = Poses.from_centres(_OPENGL @ inverse.rotation, inverse.centres)
    as_given = _median_angle(chosen, true)
    for other, axes in ((inverse, ""), (opengl, " and in OpenCV's axes, not OpenGL's")):
        angle = _median_angle(other, true)
        if as_given > _CLEARLY_OFF_DEG and angle < _CLEARLY_BETTER * as_given:
            return (
                f"the extrinsics look camera-to-world: between two cameras they are {as_given:.1f} "
                f"degrees off the truth as they stand, {angle:.1f} once inverted{axes}"
            )
    return None


def _scaled_alike(ratio: Floats) -> Bools:
    """Whether x and y are off by the same clear factor, (N,)."""
    positive = np.asarray((ratio > 0.0).all(axis=1))
    logs = np.log(np.where(positive[:, None], ratio, 1.0))
    alike = np.abs(logs[:, 0] - logs[:, 1]) <= _SAME_RATIO
    clear = np.abs(logs).min(axis=1) > np.log(_RESOLUTION_RATIO)
    return np.asarray(positive & alike & clear)


def _median_angle(poses: Poses, truth: Poses) -> float:
    first, second = np.triu_indices(len(poses), 1)
    (turn, sight), (true_turn, true_sight) = (
        relative_poses(one, first, second) for one in (poses, truth)
    )
    worse = np.maximum(rotation_angle_deg(turn, true_turn), angle_deg(sight, true_sight))
    return float(np.median(worse))
