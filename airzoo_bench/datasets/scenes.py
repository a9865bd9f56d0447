"""A scene as the files of a dataset state it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from airzoo_bench.core.errors import CameraError, first_of
from airzoo_bench.datasets.metadata import PhotoPrior
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses

_OFF_CENTRE = 0.2  # a matrix for photos of half the size has its principal point 0.25 off


@dataclass(frozen=True, eq=False)
class NativeScene:
    """Photos, poses and maps of a scene, in the conventions of `geometry`.

    Attributes
    ----------
    names : tuple of N str
        Photos with a pose, relative to the folder `images`; `unposed` are the others, `absent`
        names that have a pose and no photo.
    crs : str
        Of `poses`: projected, in metres; `geometry.crs.LOCAL_CRS` for a frame in metres, z up, that
        has no place on the earth, where there is neither map nor surface model.
    dom, dsm, gallery, cloud : Path or None
        Map, surface model, the map that tiles are cut from where it is another than `dom`, true
        cloud. Tracks that need one that is missing have no truth.
    maps : Path or None
        Folder of a map and a surface model for each photo, see `matching.truth.photo_maps`.
    plane_height_m : float or None
        z0; None for the median height of the surface model, or where there is no ground.
    priors : Poses or None
        NaN where a photo has none; `metadata` is what photos state, by name. Where `is_metadata`,
        poses are the metadata's, which are no priors then.
    conditions : mapping of str to sequence of N
        Further columns of queries.csv, by which scores can be broken down.
    notes : tuple of str
        Sentences for the user about this scene, such as values that were assumed.
    poses_from, crs_from : Path or None, str
        Where poses and CRS are stated, for messages.
    truth_accuracy_m : float or None
        Standard error of the true positions, where it is stated.
    """

    scene: str
    images: Path
    names: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    crs: str
    absent: tuple[str, ...] = ()
    dom: Path | None = None
    dsm: Path | None = None
    gallery: Path | None = None
    cloud: Path | None = None
    maps: Path | None = None
    plane_height_m: float | None = None
    priors: Poses | None = None
    metadata: Mapping[str, PhotoPrior] = field(default_factory=dict)
    is_metadata: bool = False
    conditions: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    unposed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    poses_from: Path | None = None
    crs_from: str = ""
    truth_accuracy_m: float | None = None

    @property
    def files(self) -> dict[str, Path]:
        """Files that the benchmark refers to, by their names in benchmark.toml."""
        names = ("images", "dom", "dsm", "gallery", "cloud", "maps")
        return {name: path for name in names if (path := getattr(self, name)) is not None}


@dataclass(frozen=True, eq=False)
class ImageScene:
    """Queries and gallery of a benchmark that gives images, and states which belong together.

    Images have an `id`, a file `image`, and positions in `POSITION_COLUMNS` or none; other columns
    of queries are conditions. Pairs have the rows of `query` and `tile`, whether they are
    `positive`, and the `overlap`, from 0 to 1, where it is stated.
    """

    scene: str
    queries: pd.DataFrame
    gallery: pd.DataFrame
    images: Path
    tiles: Path
    pairs: pd.DataFrame
    gallery_size: int | None = None
    notes: tuple[str, ...] = ()


class PosedPhotos(NamedTuple):
    """N photos with cameras and poses; no CRS where it is not stated; `absent` have no photo."""

    names: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    crs: str = ""
    absent: tuple[str, ...] = ()

    def take(self, rows: Sequence[int]) -> PosedPhotos:
        """Return some of the photos, by their rows."""
        names, chosen = tuple(self.names[row] for row in rows), np.asarray(rows, dtype=np.int64)
        cameras, poses = self.cameras.take(chosen), self.poses.take(chosen)
        return self._replace(names=names, cameras=cameras, poses=poses)


def check_centred(photos: PosedPhotos, path: object) -> None:
    """Refuse cameras with a principal point far from the middle of the photo."""
    size = np.stack([photos.cameras.width, photos.cameras.height], axis=1)
    off = np.abs(photos.cameras.principal_point / size - 0.5)
    bad = np.flatnonzero((off > _OFF_CENTRE).any(axis=1)).tolist()
    if bad:
        (cx, cy), (width, height) = photos.cameras.principal_point[bad[0]], size[bad[0]]
        what = "camera matrices of another image size: "
        what += f"{first_of([photos.names[row] for row in bad], len(photos.names))}; the first is "
        what += f"{width}x{height} px, with the principal point at ({cx:.1f}, {cy:.1f})"
        fix = "scale K to the size of the photos; photos of several sizes need a K each"
        if abs(cx / height - 0.5) < _OFF_CENTRE > abs(cy / width - 0.5):
            fix = "the photo is turned by 90 degrees against its K: turn one of both"
        raise CameraError(what, where=path, fix=fix)
