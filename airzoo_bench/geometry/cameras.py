"""Calibrated cameras: intrinsics, lens, projection and back-projection.

Pixel centres sit at integer + 0.5: the image's corner is (0, 0) and its far corner (width, height).
Camera axes are OpenCV's: x right, y down, z forward.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import CameraError
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, refuse_cameras
from airzoo_bench.geometry.lens import distort, in_range, undistort

__all__ = ["Cameras", "anchor_pixels", "back_project", "project"]

_FIELDS = ("width", "height", "focal", "principal_point", "distortion")
# Entries of K that should be 0 or 1 may be off by this much: far below any effect on a pixel.
_K_TOLERANCE = 1e-9
# Beyond these no camera is, and squares of rays overflow.
_LEAST_FOCAL_PX, _LARGEST_PX = 1e-6, 1e12


@dataclass(frozen=True, eq=False)
class Cameras:
    """Intrinsics of N cameras.

    Parameters
    ----------
    width, height : (N,) int64 array
        Image size in pixels.
    focal : (N, 2) array
        fx, fy in pixels.
    principal_point : (N, 2) array
        cx, cy in pixels, the image's corner being (0, 0).
    distortion : (N, 5) array
        k1 k2 p1 p2 k3, OpenCV's order; zeros make a pinhole.

    Raises
    ------
    CameraError
        When the arrays do not have these shapes.
    """

    width: Ints
    height: Ints
    focal: Floats
    principal_point: Floats
    distortion: Floats

    def __post_init__(self) -> None:
        count = len(self.focal)
        shapes = ((count,), (count,), (count, 2), (count, 2), (count, 5))
        for name, shape in zip(_FIELDS, shapes, strict=True):
            _require_shape(name, getattr(self, name), shape)

    @classmethod
    def from_matrices(
        cls,
        K: ArrayLike,
        width: ArrayLike,
        height: ArrayLike,
        distortion: ArrayLike | None = None,
        names: Sequence[object] | None = None,
    ) -> Cameras:
        """Build cameras from calibration matrices, refusing what is none.

        Parameters
        ----------
        K : (N, 3, 3) array
            Rows (fx, 0, cx), (0, fy, cy), (0, 0, 1).
        width, height : (N,) array or scalar
            Image size in pixels.
        distortion : (N, 4) or (N, 5) array, optional
            k1 k2 p1 p2 and k3; a pinhole where left out.
        names : sequence of N, optional
            Names of the cameras for messages.

        Raises
        ------
        CameraError
            Bad shapes, entries that are not finite, a focal length that is not positive, skew or
            other entries that should be zero, a size that is not a positive whole number. The
            first three cameras are named, with how many there are.
        """
        matrices = np.asarray(K, dtype=np.float64)
        count = len(matrices) if matrices.ndim else 0
        _require_shape("K", matrices, (count, 3, 3))
        _check_matrices(matrices, names)
        return cls(
            width=_sizes("width", width, count, names),
            height=_sizes("height", height, count, names),
            focal=matrices[:, (0, 1), (0, 1)],
            principal_point=matrices[:, :2, 2].copy(),
            distortion=_distortion(distortion, count, names),
        )

    @classmethod
    def joined(cls, parts: Sequence[Cameras]) -> Cameras:
        """Return the cameras of some batches, one after the other; at least one batch.

        Parameters
        ----------
        parts : sequence of Cameras
            At least one.

        Returns
        -------
        Cameras
            In their order.
        """
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in _FIELDS))

    def __len__(self) -> int:
        return len(self.focal)

    @property
    def matrices(self) -> Floats:
        """Calibration matrices K, (N, 3, 3)."""
        matrices = np.tile(np.eye(3), (len(self), 1, 1))
        matrices[:, (0, 1), (0, 1)] = self.focal
        matrices[:, :2, 2] = self.principal_point
        return matrices

    def take(self, index: Any) -> Cameras:
        """Return the cameras at an integer, index array, mask or slice, as Cameras.

        Parameters
        ----------
        index : int, slice or array
            Of integers, or a mask (N,).

        Returns
        -------
        Cameras
            One for an integer.
        """
        rows = np.atleast_1d(np.arange(len(self))[index])
        return Cameras(*(getattr(self, name)[rows] for name in _FIELDS))

    def scaled(self, width: ArrayLike, height: ArrayLike) -> Cameras:
        """Return the cameras of the images resized to `width` x `height`.

        With the image's corner at (0, 0) focal length and principal point scale alike; the
        distortion works on normalised points and stays.

        Parameters
        ----------
        width, height : (N,) array or scalar
            In pixels.

        Returns
        -------
        Cameras
            Focal length and principal point in the new pixels.

        Raises
        ------
        CameraError
            A size that is not a positive whole number.
        """
        new_width = _sizes("width", width, len(self), None)
        new_height = _sizes("height", height, len(self), None)
        scale = np.stack((new_width / self.width, new_height / self.height), axis=-1)
        focal, principal_point = self.focal * scale, self.principal_point * scale
        return Cameras(new_width, new_height, focal, principal_point, self.distortion)


def project(cameras: Cameras, points_cam: Floats) -> Floats:
    """Project points of the camera frame.

    Parameters
    ----------
    cameras : Cameras
        N cameras; one broadcasts over all points.
    points_cam : (N, M, 3) array
        x right, y down, z forward.

    Returns
    -------
    (N, M, 2) array
        Pixels, also outside the image. NaN where the point has no image: z <= 0, or outside the
        range of the lens model (where the polynomial would fold it back into the image).
    """
    z = points_cam[..., 2:]
    with np.errstate(over="ignore", invalid="ignore"):
        xy = points_cam[..., :2] / np.where(z > 0.0, z, np.nan)
        seen = in_range(xy, cameras.distortion)
        distorted = distort(xy, cameras.distortion)
        pixels = distorted * cameras.focal[:, None] + cameras.principal_point[:, None]
    return np.where(seen[..., None], pixels, np.nan)


def back_project(cameras: Cameras, pixels: Floats) -> Floats:
    """Turn pixels into unit rays of the camera frame, lens distortion undone.

    Parameters
    ----------
    cameras : Cameras
        N cameras; one broadcasts over all pixels.
    pixels : (N, M, 2) array
        The image's corner is (0, 0).

    Returns
    -------
    (N, M, 3) array
        Unit vectors; NaN for pixels beyond the range of the lens model (see `undistort`).
    """
    distorted = (pixels - cameras.principal_point[:, None]) / cameras.focal[:, None]
    xy = undistort(distorted, cameras.distortion)
    x, y = xy[..., 0], xy[..., 1]
    norm = np.sqrt(x * x + y * y + 1.0)
    return np.stack((x / norm, y / norm, 1.0 / norm), axis=-1)


def anchor_pixels(cameras: Cameras, inset: float = 1 / 16) -> Floats:
    """Return the four anchor pixels of the retrieval ground truth (PROTOCOLS.md, track 1).

    Parameters
    ----------
    cameras : Cameras
        N cameras.
    inset : float
        Distance from the border as a share of width and height, 0 <= inset < 0.5; 0 gives the
        image's corners.

    Returns
    -------
    (N, 4, 2) array
        Pixels: top left, top right, bottom right, bottom left.

    Raises
    ------
    CameraError
        `inset` out of its bounds.
    """
    if not 0.0 <= inset < 0.5:
        raise CameraError(f"anchor inset {inset} is not possible", expected="0 <= inset < 0.5")
    near, far = inset, 1.0 - inset
    share = np.array([(near, near), (far, near), (far, far), (near, far)])
    size = np.stack((cameras.width, cameras.height), axis=-1)
    anchors: Floats = share * size[:, None]
    return anchors


def _require_shape(name: str, array: Any, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise CameraError(f"{name} has shape {array.shape}", expected=f"shape {shape}")


def _check_matrices(matrices: Floats, names: Sequence[object] | None) -> None:
    def refuse(bad: Bools | np.bool_, what: str) -> None:
        expected = "K = [fx 0 cx; 0 fy cy; 0 0 1] with fx, fy > 0, in pixels"
        refuse_cameras(bad, what, names=names, expected=expected)

    refuse(~np.isfinite(matrices).all(axis=(1, 2)), "K has NaN or infinite entries")
    focal, entries = matrices[:, (0, 1), (0, 1)], np.abs(matrices).max(axis=(1, 2))
    refuse((focal <= 0.0).any(axis=1), "K has no positive focal length")
    beyond = (focal < _LEAST_FOCAL_PX).any(axis=1) | (entries > _LARGEST_PX)
    refuse(beyond, f"K has a focal length below {_LEAST_FOCAL_PX:g} px or an entry above 1e12")
    refuse(np.abs(matrices[:, 0, 1]) > _K_TOLERANCE, "K has skew")
    refuse(np.abs(matrices[:, 1, 0]) > _K_TOLERANCE, "K has a non-zero entry in row 2, column 1")
    off = np.abs(matrices[:, 2] - (0.0, 0.0, 1.0)).max(axis=1)
    refuse(off > _K_TOLERANCE, "K has a last row other than 0 0 1")


def _sizes(name: str, value: ArrayLike, count: int, names: Sequence[object] | None) -> Ints:
    given = np.asarray(value, dtype=np.float64)
    if given.shape not in ((), (count,)):
        raise CameraError(f"{name} has shape {given.shape}", expected=f"a scalar or ({count},)")
    sizes = np.broadcast_to(given, (count,))
    whole = np.isfinite(sizes) & (sizes > 0.0) & (np.floor(sizes) == sizes)
    refuse_cameras(
        ~whole, f"image {name} is not a size", names=names, expected="a positive whole number"
    )
    return sizes.astype(np.int64)


def _distortion(value: ArrayLike | None, count: int, names: Sequence[object] | None) -> Floats:
    full = np.zeros((count, 5))
    if value is None:
        return full
    given = np.asarray(value, dtype=np.float64)
    if given.shape not in ((count, 4), (count, 5)):
        raise CameraError(
            f"distortion has shape {given.shape}",
            expected=f"({count}, 4) k1 k2 p1 p2 or ({count}, 5) k1 k2 p1 p2 k3",
        )
    bad = ~np.isfinite(given).all(axis=1)
    refuse_cameras(bad, "distortion has NaN or infinite coefficients", names=names)
    full[:, : given.shape[1]] = given
    return full
