"""Where on the ground a photo looks: rays through four anchor pixels, met with the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project
from airzoo_bench.geometry.frames import to_lonlat, unwrapped
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rays import RayStatus, intersect_heightfield, intersect_plane
from airzoo_bench.retrieval.gallery import LONLAT_DECIMALS

__all__ = ["Footprints", "cast_footprints"]


@dataclass(frozen=True)
class Footprints:
    """The ground points of N photos.

    Attributes
    ----------
    lonlat : (N, 4, 2) float64
        Anchor points on the ground in degrees, in the order of the image's corners; NaN where the
        ray has no ground point.
    status : (N, 4) uint8
        A `RayStatus` for each ray.
    centres : (N, 2) float64
        Lon, lat of the mean of the ground points that there are; NaN where there is none.
    """

    lonlat: NDArray[np.float64]
    status: NDArray[np.uint8]
    centres: NDArray[np.float64]

    @property
    def missed_rays(self) -> NDArray[np.int64]:
        """How many of the four rays of each photo (N,) meet no ground."""
        missed: NDArray[np.int64] = np.count_nonzero(self.status != RayStatus.HIT, axis=1)
        return missed

    def about(self, lon: float) -> Footprints:
        """Return the same with longitudes unwrapped about one; see `frames.unwrapped`."""
        lonlat, centres = (
            np.round(unwrapped(part, lon), LONLAT_DECIMALS) for part in (self.lonlat, self.centres)
        )
        return Footprints(lonlat, self.status, centres)


def cast_footprints(
    cameras: Cameras,
    poses: Poses,
    crs: str,
    ground: float | HeightField,
    *,
    inset: float,
    max_range_m: float,
) -> Footprints:
    """Cast the anchor rays of N photos.

    Parameters
    ----------
    cameras, poses : Cameras, Poses
        Of the N photos; poses in `crs`.
    crs : str
        Projected CRS of the poses, in metres.
    ground : float or HeightField
        The height of the plane z = z0, or the surface model.
    inset : float
        Distance of the anchors from the image's border, as a share of width and height.
    max_range_m : float
        A ray that meets the ground farther away has no ground point.

    Returns
    -------
    Footprints

    References
    ----------
    AirZoo paper, "Ground truth construction".
    """
    rays = rays_to_world(poses, back_project(cameras, anchor_pixels(cameras, inset)))
    if isinstance(ground, HeightField):
        hits = intersect_heightfield(poses.centres, rays, ground, max_range_m)
    else:
        hits = intersect_plane(poses.centres, rays, ground, max_range_m)
    xy = hits.points[..., :2]
    return Footprints(
        np.round(to_lonlat(crs, xy), LONLAT_DECIMALS),
        hits.status,
        np.round(to_lonlat(crs, _mean_of_hits(xy, hits.valid)), LONLAT_DECIMALS),
    )


def _mean_of_hits(xy: NDArray[np.float64], hit: NDArray[np.bool_]) -> NDArray[np.float64]:
    total = np.where(hit[..., None], xy, 0.0).sum(axis=1)
    count = hit.sum(axis=1)[:, None]
    middle: NDArray[np.float64] = np.full_like(total, np.nan)
    np.divide(total, count, out=middle, where=count > 0)
    return middle
