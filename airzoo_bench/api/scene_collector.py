"""Answers of the reconstruction track, collected: clouds with cameras, or depth maps."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api.arrays import coordinates, numbers
from airzoo_bench.api.collectors import Collector, Fields, RowFile, index_of
from airzoo_bench.api.labels import same_index
from airzoo_bench.api.scene import BlindScene
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import atomic_entries, write_npz
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.view_plausibility import refuse_other_resolution

__all__ = ["SceneCollector"]

_ENDINGS = (".ply", ".cameras.npz", ".npz")


class SceneCollector(Collector):
    """A cloud a scene with the cameras of its photos, or a depth map a photo.

    Parameters
    ----------
    scenes : sequence of BlindScene
        Of the protocol.
    folder : Path
        Keeps clouds and depth maps until all is written, so that they need not stay in memory.
    """

    def __init__(self, scenes: Sequence[BlindScene], folder: Path) -> None:
        self._out = folder / "finished"
        self._out.mkdir()
        self._scenes = {scene.id: _Scene(scene, folder) for scene in scenes}
        self._photos = {
            photo.id: (scene.id, row)
            for scene in scenes
            for row, photo in enumerate(scene.photos())
        }

    def add(self, name: str, fields: Fields) -> None:
        """See `Collector.add`: of a cloud, a camera or a depth map."""
        if "points" in fields:
            index_of(name, dict.fromkeys(self._scenes, 0), "scene of the benchmark")
            self._add_cloud(name, fields)
            return
        index_of(name, dict.fromkeys(self._photos, 0), "photo of the reconstruction")
        scene, row = self._photos[name]
        self._scenes[scene].add(row, name, fields)

    def _add_cloud(self, scene: str, fields: Fields) -> None:
        same_index(fields)
        points = coordinates("points", fields["points"], any_history=True)
        colours = fields.get("colours")
        if colours is not None:
            colours = numbers("colours", colours, (len(points), 3))
            if colours.dtype != np.uint8:
                raise PredictionError(f"colours are {colours.dtype}", expected="uint8")
        if not len(points):
            raise PredictionError("points is empty", expected="points, or no cloud at all")
        self._scenes[scene].take_cloud()
        write_ply(self._out / f"{scene}.ply", Cloud(points, colours))

    def missing(self) -> tuple[str, ...]:
        """See `Collector.missing`: scenes without a cloud or a depth map."""
        return tuple(name for name, scene in self._scenes.items() if not scene.has_geometry)

    def write(self, path: Path, protocol: str) -> None:
        """See `Collector.write`."""
        for name, scene in self._scenes.items():
            arrays = scene.arrays()
            if arrays:
                ending = ".npz" if "depth" in arrays else ".cameras.npz"
                write_npz(self._out / f"{name}{ending}", arrays)
        (self._out / "protocol.txt").write_text(f"{protocol}\n", encoding="utf-8")
        entries = [f"{name}{ending}" for name in self._scenes for ending in _ENDINGS]
        with atomic_entries(path, ("protocol.txt", *entries)) as folder:
            for entry in self._out.iterdir():
                shutil.move(entry, folder / entry.name)


class _Scene:
    """The cameras of a scene's photos, and their depth maps where it has no cloud."""

    def __init__(self, scene: BlindScene, folder: Path) -> None:
        self._names = [photo.name for photo in scene.photos()]
        count = len(self._names)
        self._depth = RowFile(folder / f"{scene.id}.depth", "depth", count, axes=2)
        self._confidence = RowFile(folder / f"{scene.id}.conf", "confidence", count, axes=2)
        self._extrinsics: dict[int, NDArray[np.float64]] = {}
        self._intrinsics: dict[int, NDArray[np.float64]] = {}
        self._has_cloud = False

    @property
    def has_geometry(self) -> bool:
        return self._has_cloud or bool(self._intrinsics)

    def take_cloud(self) -> None:
        if self._intrinsics:
            raise _both()
        self._has_cloud = True

    def add(self, row: int, name: str, fields: Fields) -> None:
        extrinsics = _extrinsics(name, fields["rotation"], fields["centre"])
        if "depth" in fields:
            self._add_depth(row, name, fields)
        elif self._intrinsics:
            raise PredictionError("has no depth, unlike the photos of its scene before")
        self._extrinsics[row] = extrinsics

    def _add_depth(self, row: int, name: str, fields: Fields) -> None:
        if self._has_cloud or len(self._extrinsics) > len(self._intrinsics):
            raise _both()
        depth = self._depth.check(fields["depth"])
        given = fields.get("confidence")
        confidence = None if given is None else self._confidence.check(given)
        if confidence is not None and confidence.shape != depth.shape:
            raise PredictionError(
                f"confidence has shape {confidence.shape}", expected=f"{depth.shape}, as depth has"
            )
        if self._intrinsics and (confidence is not None) != self._confidence.there.any():
            raise PredictionError("confidence with some photos only", expected="with all, or none")
        self._intrinsics[row] = _intrinsics(name, fields["intrinsics"], depth.shape)
        self._depth.put(row, depth)
        if confidence is not None:
            self._confidence.put(row, confidence)

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Return the fields of the file of cameras or depth maps; nothing where there are none."""
        rows = sorted(self._extrinsics)
        if not rows:
            return {}
        arrays: dict[str, NDArray[Any]] = {
            "image_names": np.array([self._names[row] for row in rows], dtype=str),
            "extrinsics": np.stack([self._extrinsics[row] for row in rows]),
        }
        if self._intrinsics:
            arrays["intrinsics"] = np.stack([self._intrinsics[row] for row in rows])
            arrays["pixel_centres"] = np.array("half")
            arrays["depth"] = self._depth.packed()
        if self._confidence.there.any():
            arrays["conf"] = self._confidence.packed()
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
    refuse_other_resolution(cameras, [name], "intrinsics")
    return given


def _both() -> PredictionError:
    return PredictionError(
        "a cloud and depth maps in one scene", expected="one of the two, the cloud with cameras"
    )
