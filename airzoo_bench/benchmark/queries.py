"""The table of a scene's photos, shared by all tracks: camera, pose, prior, conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark, needed
from airzoo_bench.benchmark.tables import read_table, refuse_cells
from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, matrix_to_quaternion, quaternion_to_matrix

if TYPE_CHECKING:
    from airzoo_bench.geometry.rasters import RasterInfo  # loads GDAL, which retrieval does without

IDENTITY_COLUMNS = ("id", "image")
SIZE_COLUMNS = ("width", "height")
FOCAL_COLUMNS = ("fx", "fy")
PRINCIPAL_POINT_COLUMNS = ("cx", "cy")
DISTORTION_COLUMNS = ("k1", "k2", "p1", "p2", "k3")
CAMERA_COLUMNS = (*SIZE_COLUMNS, *FOCAL_COLUMNS, *PRINCIPAL_POINT_COLUMNS, *DISTORTION_COLUMNS)
POSE_COLUMNS = ("qw", "qx", "qy", "qz", "x", "y", "z")
NO_POSE = "no pose"
PRIOR_COLUMNS = tuple(f"prior_{name}" for name in POSE_COLUMNS)
_LISTED = {"matching": "crops.csv", "reconstruction": "photos.csv"}


def write_queries(folder: Path, queries: pd.DataFrame) -> None:
    """Write a scene's ``queries.csv``, sorted by id."""
    folder.mkdir(parents=True, exist_ok=True)
    ordered = queries.sort_values("id", kind="stable")
    ordered.to_csv(folder / "queries.csv", index=False, lineterminator="\n")


def read_queries(
    folder: Path, excluded: pd.DataFrame, complete: Sequence[str] = ()
) -> pd.DataFrame:
    """Read a scene's photos except those that a track leaves out."""
    path = folder / "queries.csv"
    everything = read_table(path, (*IDENTITY_COLUMNS, *complete))
    kept = ~everything["id"].isin(excluded["id"])
    for name in (one for one in complete if everything[one].hasnans):
        missing = (kept & everything[name].isna()).to_numpy()
        refuse_cells(path, name, everything[name], missing, "a number", everything["id"].tolist())
    return everything[kept].reset_index(drop=True)


def read_excluded(benchmark: Benchmark, scene: str, track: str) -> pd.DataFrame:
    """Read which photos of a scene a track leaves out, with the reasons."""
    folder = benchmark.scene_folder(scene)
    if not benchmark.is_sealed:
        return read_table(folder / track / "excluded.csv", (*IDENTITY_COLUMNS, "reason"))
    photos = read_table(folder / "queries.csv", IDENTITY_COLUMNS)[list(IDENTITY_COLUMNS)]
    listed = _LISTED.get(track)
    asked = photos["id"] if listed is None else read_table(folder / track / listed, ("id",))["id"]
    left_out = photos[~photos["id"].isin(asked)].reset_index(drop=True)
    return left_out.assign(reason="not asked")


def cameras_of(queries: pd.DataFrame) -> Cameras:
    """Return the cameras of a table's rows."""
    _check_complete(queries, CAMERA_COLUMNS, "camera parameters")
    return Cameras(
        queries["width"].to_numpy(np.int64),
        queries["height"].to_numpy(np.int64),
        _values(queries, FOCAL_COLUMNS),
        _values(queries, PRINCIPAL_POINT_COLUMNS),
        _values(queries, DISTORTION_COLUMNS),
    )


def poses_of(queries: pd.DataFrame, columns: tuple[str, ...] = POSE_COLUMNS) -> Poses:
    """Return the poses of a table's rows, or their priors."""
    _check_complete(queries, columns, "a pose" if columns == POSE_COLUMNS else "a prior pose")
    numbers = _values(queries, columns)
    return Poses(rotation=quaternion_to_matrix(numbers[:, :4]), centres=numbers[:, 4:])


def conditions_of(queries: pd.DataFrame) -> pd.DataFrame:
    """Return the columns that are neither identity nor geometry."""
    known = {*IDENTITY_COLUMNS, *CAMERA_COLUMNS, *POSE_COLUMNS, *PRIOR_COLUMNS}
    names = [name for name in queries.columns if name not in known]
    return queries[names].reset_index(drop=True)


def _check_complete(queries: pd.DataFrame, columns: Sequence[str], what: str) -> None:
    missing = [name for name in columns if name not in queries.columns]
    if missing:
        raise BenchmarkError(f"the queries lack the columns {', '.join(missing)} ({what})")
    rows = np.flatnonzero(~np.isfinite(_values(queries, columns)).all(axis=1))
    if rows.size:
        named = first_of(queries["id"].iloc[rows], len(queries))
        raise BenchmarkError(f"queries without {what}: {named}", fix="prepare the benchmark again")


def _values(queries: pd.DataFrame, columns: Sequence[str]) -> NDArray[np.float64]:
    return queries[list(columns)].to_numpy(np.float64)


@dataclass(frozen=True, eq=False)
class SceneInputs:
    """The photos of a scene, their maps and frames; see `SceneFile` for most.

    `photos` is as `photo_table` makes it; `unposed` are names of photos without a pose, which no
    track can ask; `maps` is the folder of a map and a surface model for each photo.
    """

    scene: str
    photos: pd.DataFrame
    crs: str | None
    dom: RasterInfo | None
    dsm: Path | None
    plane_height_m: float | None
    unposed: tuple[str, ...] = ()
    gallery: RasterInfo | None = None
    maps: Path | None = None

    @property
    def gallery_map(self) -> RasterInfo:
        """The map that tiles are cut from."""
        return needed(self.gallery or self.dom, "map", self.scene)


def photo_id(scene: str, image: str) -> str:
    """Return the id of a photo: the scene, and the file's name without its ending."""
    return f"{scene}/{Path(image).with_suffix('').as_posix()}"


def photo_table(
    scene: str,
    images: tuple[str, ...],
    cameras: Cameras | None,
    poses: Poses | None,
    priors: Poses | None,
    plane_height_m: float | None,
) -> pd.DataFrame:
    """Lay out a scene's photos, sorted by id, with altitude and pitch as conditions."""
    ids = [photo_id(scene, name) for name in images]
    if cameras is None or poses is None:
        table = pd.DataFrame({"id": ids, "image": list(images)})
        return table.sort_values("id", kind="stable", ignore_index=True)
    poses, priors = poses.rounded(), None if priors is None else priors.rounded()
    axis_z = poses.rotation[:, 2, 2]
    below_horizon = np.degrees(np.arcsin(np.clip(-axis_z, -1, 1)))
    columns: dict[str, object] = {"id": ids, "image": list(images)}
    columns |= {"width": cameras.width, "height": cameras.height}
    parts = [
        (FOCAL_COLUMNS, cameras.focal),
        (PRINCIPAL_POINT_COLUMNS, cameras.principal_point),
        (DISTORTION_COLUMNS, cameras.distortion),
    ]
    for names, given in ((POSE_COLUMNS, poses), (PRIOR_COLUMNS, priors)):
        if given is not None:
            quaternions = matrix_to_quaternion(given.rotation)
            parts.append((names, np.concatenate([quaternions, given.centres], axis=1)))
    for names, values in parts:
        columns |= dict(zip(names, values.T, strict=True))
    table = pd.DataFrame(columns)
    if plane_height_m is not None:
        table["altitude_m"] = np.round(poses.centres[:, 2] - plane_height_m, 3)
    table["pitch_deg"] = np.round(below_horizon, 3)
    return table.sort_values("id", kind="stable", ignore_index=True)


def with_unposed(left_out: pd.DataFrame, inputs: SceneInputs) -> pd.DataFrame:
    """Add the photos without a pose to the photos that a track leaves out, sorted by id."""
    if not inputs.unposed:
        return left_out
    # Names that no text file can hold are written as Python would escape them.
    names = [name.encode("utf-8", "backslashreplace").decode() for name in inputs.unposed]
    ids = [photo_id(inputs.scene, name) for name in names]
    rows = pd.DataFrame({"id": ids, "image": names, "reason": NO_POSE})
    parts = [part for part in (left_out, rows) if not part.empty]
    return pd.concat(parts).sort_values("id", kind="stable", ignore_index=True)
