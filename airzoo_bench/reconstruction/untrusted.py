"""Scenes of predictions that are not trusted: each is read by a child, into plain files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud
from airzoo_bench.formats.clouds.meshes import MeshSampling
from airzoo_bench.reconstruction.fusion import DepthMaps, LazyMaps, PointMaps
from airzoo_bench.reconstruction.predictions import ReconstructionPredictions, ScenePrediction

__all__ = ["UntrustedScenes", "list_scenes", "store_scene"]

_BLOCK_POINTS = 1 << 20


@dataclass(frozen=True)
class UntrustedScenes(ReconstructionPredictions):
    """Predictions as a child lists them; `read_scene` has another child read a scene."""

    path: Path
    protocol: str | None
    unknown_files: tuple[str, ...]
    names: tuple[str, ...]
    read_scene: Callable[..., ScenePrediction] | None = None

    @property
    def scenes(self) -> tuple[str, ...]:
        """Scenes that there is an entry of, by name."""
        return self.names

    @contextmanager
    def opened(
        self, scene: str, *, limit_bytes: int, sampling: MeshSampling | None
    ) -> Iterator[ScenePrediction]:
        """See `ReconstructionPredictions.opened`."""
        assert self.read_scene is not None
        found = self.read_scene(scene=scene, limit_bytes=limit_bytes, sampling=sampling)
        geometry: Any = found.geometry
        if isinstance(geometry, _StoredCloud):
            geometry = geometry.as_file_cloud()
        yield replace(found, geometry=geometry)


@dataclass(frozen=True, eq=False)
class _StoredCloud:
    """A cloud whose points (N, 3), and confidence (N,) where it has some, are in plain files."""

    path: Path
    kind: str
    count: int
    precision: np.dtype[Any]
    notes: tuple[str, ...]
    points: Path
    confidence: Path | None

    def as_file_cloud(self) -> FileCloud:
        """Return the cloud, once the files are known to hold as many points as it says."""
        for file, shape in ((self.points, (self.count, 3)), (self.confidence, (self.count,))):
            if file is not None and np.load(file, mmap_mode="r").shape != shape:
                raise PredictionError("its points are not as many as it says", where=self.path)
        read = partial(_read_stored, self.points, self.confidence)
        return FileCloud(self.path, self.kind, self.count, read, self.precision, self.notes)


def _read_stored(points: Path, confidence: Path | None, size: int) -> Iterator[Cloud]:
    xyz = np.load(points, mmap_mode="r")
    trust = None if confidence is None else np.load(confidence, mmap_mode="r")
    for start in range(0, len(xyz), size):
        part = slice(start, start + size)
        yield Cloud(np.array(xyz[part]), None, None if trust is None else np.array(trust[part]))


def list_scenes(predictions: ReconstructionPredictions) -> UntrustedScenes:
    """Return the scenes of predictions without what reads them."""
    return UntrustedScenes(
        predictions.path,
        predictions.protocol,
        tuple(predictions.unknown_files),
        tuple(predictions.scenes),
    )


def store_scene(found: ScenePrediction, folder: Path) -> ScenePrediction:
    """Leave what a scene holds in files of a folder, unless it is mapped from files already."""
    geometry: Any = found.geometry
    if isinstance(geometry, FileCloud):
        geometry = _store_cloud(geometry, folder)
    elif isinstance(geometry, DepthMaps):
        depth = _store_maps(geometry.depth, folder / "depth.npy")
        confidence = _store_maps(geometry.confidence, folder / "conf.npy")
        geometry = replace(geometry, depth=depth, confidence=confidence)
    elif isinstance(geometry, PointMaps):
        points = _store_maps(geometry.points, folder / "points.npy")
        geometry = PointMaps(points, _store_maps(geometry.confidence, folder / "conf.npy"))
    return replace(found, geometry=geometry)


def _store_cloud(cloud: FileCloud, folder: Path) -> _StoredCloud:
    points, confidence = folder / "points.npy", folder / "confidence.npy"
    xyz = np.lib.format.open_memmap(points, "w+", np.float64, (cloud.count, 3))
    trust, done = None, 0
    for piece in cloud.pieces(_BLOCK_POINTS):
        part = slice(done, done + len(piece))
        done += len(piece)
        if done > cloud.count:
            break
        xyz[part] = piece.points
        if piece.confidence is not None:
            if trust is None:
                trust = np.lib.format.open_memmap(confidence, "w+", np.float32, (cloud.count,))
            trust[part] = piece.confidence
    if done != cloud.count:
        raise PredictionError(
            f"says that it holds {cloud.count:,} points, and holds {done:,}", where=cloud.path
        )
    return _StoredCloud(
        cloud.path,
        cloud.kind,
        cloud.count,
        cloud.precision,
        cloud.notes,
        points,
        None if trust is None else confidence,
    )


def _store_maps(maps: Any, path: Path) -> Any:
    if not isinstance(maps, LazyMaps):
        return maps
    stored = np.lib.format.open_memmap(path, "w+", maps.dtype, maps.shape)
    for row in range(len(maps)):
        stored[row] = maps[row]
    return stored
