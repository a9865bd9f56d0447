"""A scene as the files of a benchmark or of own photos state it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

    from airzoo_bench.datasets.photo_metadata import PhotoPrior
    from airzoo_bench.geometry.cameras import Cameras
    from airzoo_bench.geometry.poses import Poses

__all__ = ["NativeScene"]


@dataclass(frozen=True, eq=False)
class NativeScene:
    """A scene as a benchmark's files state it, in the conventions of `geometry`.

    Attributes
    ----------
    scene : str
        Its id, that of the protocols.
    images : Path
        Folder of the photos.
    names : tuple of N str
        Photos with a pose, relative to `images`.
    cameras : Cameras or None
        N, for the photos' own size; None, as `poses` and `crs`, where photos have no poses.
    poses : Poses or None
        N, in `crs`.
    crs : str or None
        Projected, in metres; `geometry.crs.LOCAL_CRS` for a frame in metres, z up, that has no
        place on the earth, where there is neither map nor surface model.
    dom, dsm, gallery, cloud : Path or None
        Map, surface model, the map that tiles are cut from where it is another than `dom`, true
        cloud. Tracks that need one that is missing have no truth.
    maps : Path or None
        Folder of a map and a surface model for each photo, where there are none of the whole
        scene, see `matching.truth.own_map`.
    plane_height_m : float or None
        z0; None for the median height of the surface model, or where there is no ground.
    priors : Poses or None
        N, NaN where a photo has none.
    metadata : mapping of str to PhotoPrior
        What photos say of themselves, by name.
    is_metadata : bool
        Whether poses are the metadata's, which are no priors then.
    conditions : mapping of str to sequence of N
        Further columns of queries.csv, by which scores can be broken down.
    unposed : tuple of str
        Names of photos without a pose.
    notes : tuple of str
        Sentences for the user about this scene, such as values that were assumed.
    poses_from : Path or None
        The file of the poses, for messages.
    crs_from : str
        Where the CRS is stated, for messages.
    truth_accuracy_m : float or None
        Standard error of the true positions, where it is stated.
    """

    scene: str
    images: Path
    names: tuple[str, ...]
    cameras: Cameras | None
    poses: Poses | None
    crs: str | None
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
        """What the benchmark refers to, by the name that benchmark.toml has for it."""
        parts = {"images": self.images, "dom": self.dom, "dsm": self.dsm}
        parts |= {"gallery": self.gallery, "cloud": self.cloud, "maps": self.maps}
        return {key: path for key, path in parts.items() if path is not None}

    @property
    def pose_source(self) -> Path:
        """What messages about poses name: their file, or the folder of the photos."""
        return self.poses_from or self.images

    @property
    def crs_place(self) -> str:
        """What messages about the CRS name."""
        return self.crs_from or f"{self.pose_source}, scene {self.scene}"

    def condition_table(self) -> pd.DataFrame:
        """Return the conditions, a row a photo, with the column ``id``."""
        import pandas as pd

        from airzoo_bench.benchmark.queries import photo_id

        ids = [photo_id(self.scene, name) for name in self.names]
        return pd.DataFrame({"id": ids, **self.conditions})
