"""Cameras and depth maps of a scene while their predictions are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api.arrays import coordinates, in_order
from airzoo_bench.api.photos import Photo
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.checks import check_resolution

__all__ = ["RowFile", "SceneViews", "cloud_and_depth"]

_FLOATS = ("float16", "float32", "float64")


class RowFile:
    """Up to `count` rows of one shape, in a file, so that they may be larger than memory.

    Parameters
    ----------
    path : Path
        Made with the first row.
    field : str
        What the rows are called in messages.
    count : int
    axes : int
        How many axes a row has.
    """

    def __init__(self, path: Path, field: str, count: int, axes: int) -> None:
        self._path, self._field, self._axes = path, field, axes
        self.there = np.zeros(count, np.bool_)
        self._rows: NDArray[np.floating[Any]] | None = None

    def check(self, values: ArrayLike) -> NDArray[np.floating[Any]]:
        """Return a row as it will be kept: floating point, of shape and type of the first."""
        row = np.asarray(in_order(self._field, values))
        if row.dtype.name not in _FLOATS or row.ndim != self._axes or not row.size:
            raise PredictionError(
                f"{self._field} is {row.dtype} of shape {row.shape}",
                expected=f"{', '.join(_FLOATS)} with {self._axes} axes, none of them empty",
            )
        if self._rows is not None and row.shape != self._rows.shape[1:]:
            raise PredictionError(
                f"{self._field} has shape {row.shape}",
                expected=f"{self._rows.shape[1:]}, the shape of the first",
            )
        if self._rows is not None and row.dtype != self._rows.dtype:
            raise PredictionError(
                f"{self._field} is {row.dtype}, and the first was {self._rows.dtype}",
                expected="one type for all, which keeps all digits",
                fix="np.asarray(values, np.float32) for each",
            )
        return row

    def put(self, index: int, row: NDArray[np.floating[Any]]) -> None:
        """Keep a row that `check` has returned, in the type of the first."""
        if self._rows is None:
            shape = (len(self.there), *row.shape)
            self._rows = np.memmap(self._path, row.dtype, "w+", shape=shape)
        self._rows[index] = row
        self.there[index] = True

    def packed(self) -> NDArray[np.floating[Any]]:
        """Return the rows that are there, (n, ...), in order, still on disk; the last call."""
        if self._rows is None:
            raise ValueError("no row was put")
        for target, source in enumerate(np.flatnonzero(self.there)):
            if target != source:
                self._rows[target] = self._rows[source]
        return self._rows[: int(self.there.sum())]


@dataclass
class SceneViews:
    """The cameras of a scene's photos, and their depth maps where it has no cloud."""

    rows: dict[str, int]
    names: list[str]
    depth: RowFile
    confidence: RowFile
    extrinsics: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    intrinsics: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    has_cloud: bool = False

    @classmethod
    def of(cls, scene: str, photos: Sequence[Photo], folder: Path) -> SceneViews:
        """Return the views of a scene without any answer; a folder keeps depth maps."""
        depth = RowFile(folder / f"{scene}.depth", "depth", len(photos), axes=2)
        confidence = RowFile(folder / f"{scene}.conf", "confidence", len(photos), axes=2)
        rows = {photo.id: row for row, photo in enumerate(photos)}
        return cls(rows, [photo.name for photo in photos], depth, confidence)

    @property
    def has_geometry(self) -> bool:
        """Whether there is a cloud or a depth map."""
        return self.has_cloud or bool(self.intrinsics)

    def add(self, name: str, fields: Mapping[str, Any]) -> None:
        """Keep a camera, or a depth map with its camera."""
        extrinsics = _extrinsics(name, fields["rotation"], fields["centre"])
        if "depth" in fields:
            self._add_depth(name, fields)
        elif self.intrinsics:
            raise PredictionError("has no depth, unlike the photos of its scene before")
        self.extrinsics[self.rows[name]] = extrinsics

    def _add_depth(self, name: str, fields: Mapping[str, Any]) -> None:
        if self.has_cloud or len(self.extrinsics) > len(self.intrinsics):
            raise cloud_and_depth()
        depth, row = self.depth.check(fields["depth"]), self.rows[name]
        given = fields.get("confidence")
        confidence = None if given is None else self.confidence.check(given)
        if confidence is not None and confidence.shape != depth.shape:
            raise PredictionError(
                f"confidence has shape {confidence.shape}", expected=f"{depth.shape}, as depth has"
            )
        if self.intrinsics and (confidence is not None) != self.confidence.there.any():
            raise PredictionError("confidence with some photos only", expected="with all, or none")
        self.intrinsics[row] = _intrinsics(name, fields["intrinsics"], depth.shape)
        self.depth.put(row, depth)
        if confidence is not None:
            self.confidence.put(row, confidence)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the fields of the file of cameras or depth maps; nothing where there are none."""
        rows = sorted(self.extrinsics)
        if not rows:
            return {}
        arrays: dict[str, NDArray[Any]] = {
            "image_names": np.array([self.names[row] for row in rows], dtype=str),
            "extrinsics": np.stack([self.extrinsics[row] for row in rows]),
        }
        if self.intrinsics:
            arrays["intrinsics"] = np.stack([self.intrinsics[row] for row in rows])
            arrays["pixel_centres"] = np.array("half")
            arrays["depth"] = self.depth.packed()
        if self.confidence.there.any():
            arrays["conf"] = self.confidence.packed()
        return arrays


def _extrinsics(name: str, rotation: ArrayLike, centre: ArrayLike) -> NDArray[np.float64]:
    """Return a camera's [R | t], (3, 4)."""
    turned = coordinates("rotation", rotation, (3, 3), any_history=True)
    place = coordinates("centre", centre, (3,), any_history=True)
    poses = Poses.from_centres(turned[None], place[None], [name])
    return np.concatenate([poses.rotation[0], poses.translation[0][:, None]], axis=1)


def _intrinsics(name: str, matrix: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return a camera's K (3, 3), which must be of the depth map's size."""
    given = coordinates("intrinsics", matrix, (3, 3), any_history=True)
    height, width = shape
    cameras = Cameras.from_matrices(given[None], width, height, names=[name])
    check_resolution(cameras, [name], "intrinsics")
    return given


def cloud_and_depth() -> PredictionError:
    """Return the error of a scene that has a cloud and depth maps."""
    return PredictionError(
        "a cloud and depth maps in one scene", expected="one of the two, the cloud with cameras"
    )
