"""What the truth of a scene is made from, whatever the track."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.queries import query_table
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import RasterInfo

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["SceneInputs", "photo_id", "photo_table", "with_unposed"]


@dataclass(frozen=True, eq=False)
class SceneInputs:
    """Photos with poses, a map and a surface model.

    Attributes
    ----------
    scene : str
        The scene's id.
    photos : DataFrame
        A row a photo, sorted by id, as `photo_table` makes it.
    crs : str
        Projected CRS of poses and surface model, in metres.
    dom : RasterInfo
        The map, in any CRS.
    dsm : Path
        The surface model.
    plane_height_m : float
        z0, the median of the valid heights.
    unposed : tuple of str
        File names of photos without a pose, which no track can ask.
    gallery : RasterInfo, optional
        The map that tiles are cut from, where it is another than `dom`.
    """

    scene: str
    photos: pd.DataFrame
    crs: str
    dom: RasterInfo
    dsm: Path
    plane_height_m: float
    unposed: tuple[str, ...] = ()
    gallery: RasterInfo | None = None

    @property
    def gallery_map(self) -> RasterInfo:
        """The map that tiles are cut from."""
        return self.gallery or self.dom


def photo_id(scene: str, image: str) -> str:
    """Return the id of a photo: the scene, and the file's name without its ending."""
    return f"{scene}/{Path(image).with_suffix('').as_posix()}"


def photo_table(
    scene: str,
    images: tuple[str, ...],
    cameras: Cameras,
    poses: Poses,
    priors: Poses | None,
    plane_height_m: float,
) -> pd.DataFrame:
    """Lay out a scene's photos, sorted by id, with altitude and pitch as conditions.

    Poses and priors are those of the truth from here on, see `Poses.rounded`.

    Parameters
    ----------
    scene : str
    images : tuple of N str
        File names, relative to the photos' folder; without their endings they become ids.
    cameras, poses : Cameras, Poses
    priors : Poses, optional
        Poses from metadata; NaN where a photo has none.
    plane_height_m : float
        Altitudes are above it.
    """
    ids = [photo_id(scene, name) for name in images]
    poses, priors = poses.rounded(), None if priors is None else priors.rounded()
    axis_z = poses.rotation[:, 2, 2]
    below_horizon = np.degrees(np.arcsin(np.clip(-axis_z, -1, 1)))
    table = query_table(ids, images, cameras, poses, priors).assign(
        altitude_m=np.round(poses.centres[:, 2] - plane_height_m, 3),
        pitch_deg=np.round(below_horizon, 3),
    )
    return table.sort_values("id", kind="stable", ignore_index=True)


def with_unposed(left_out: pd.DataFrame, inputs: SceneInputs) -> pd.DataFrame:
    """Add the photos without a pose to a track's list of those left out, sorted by id."""
    import pandas as pd

    if not inputs.unposed:
        return left_out
    # Names that no text file can hold are written as Python would escape them.
    names = [name.encode("utf-8", "backslashreplace").decode() for name in inputs.unposed]
    ids = [photo_id(inputs.scene, name) for name in names]
    rows = pd.DataFrame({"id": ids, "image": names, "reason": "no pose"})
    parts = [part for part in (left_out, rows) if not part.empty]
    return pd.concat(parts).sort_values("id", kind="stable", ignore_index=True)
