"""Benchmark folders and prediction files made on the spot, for tests of everything above."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.benchmark import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.protocol import Protocol, load_protocol, shipped_protocols
from airzoo_bench.retrieval.pairs import Positives, offsets_of
from airzoo_bench.retrieval.truth import RetrievalTruth, write_truth

BRIGHTON = Path(__file__).resolve().parents[1] / ".." / "shared" / "real" / "brighton"
PAPER = Path(__file__).resolve().parents[1] / ".." / "shared" / "paper"

TILE_SIZE_DEG = 0.001


@dataclass(frozen=True)
class MadeScene:
    """A scene by its positives: `positives[q]` are the tile numbers that answer query q."""

    id: str
    positives: list[list[int]]
    n_tiles: int
    conditions: dict[str, list[Any]] = field(default_factory=dict)

    def query(self, number: int) -> str:
        return f"{self.id}/q{number:05d}"

    def tile(self, number: int) -> str:
        return f"{self.id}/t{number:05d}"

    @property
    def query_ids(self) -> list[str]:
        return [self.query(q) for q in range(len(self.positives))]

    @property
    def tile_ids(self) -> list[str]:
        return [self.tile(t) for t in range(self.n_tiles)]


def protocol(**changes: Any) -> Protocol:
    """Return the shipped protocol of UAV-VisLoc with some top-level values changed."""
    base = load_protocol(shipped_protocols()["uav-visloc-retrieval"])
    return Protocol.model_validate(base.model_dump(by_alias=True) | changes)


def made_protocol(scenes: list[MadeScene], name: str = "made") -> Protocol:
    """Return a protocol for made scenes."""
    return protocol(
        name=f"{name}-retrieval",
        benchmark=name,
        scenes=tuple({"id": scene.id, "title": f"Scene {scene.id}"} for scene in scenes),
    )


def write_benchmark(folder: Path, chosen: Protocol, scenes: list[MadeScene]) -> Path:
    """Write a benchmark folder whose tiles lie in a row along a parallel."""
    for scene in scenes:
        truth = made_truth(scene)
        write_truth(folder / "scenes" / scene.id, truth, truth.positives)
    protocols = folder / "protocols"
    protocols.mkdir(parents=True, exist_ok=True)
    import tomli_w

    values = chosen.model_dump(mode="json", by_alias=True, exclude_none=True)
    (protocols / f"{chosen.name}.toml").write_text(tomli_w.dumps(values), encoding="utf-8")
    entries = tuple(
        SceneFile(
            id=scene.id,
            title=scene.id,
            crs="EPSG:4547",
            plane_height_m=50.0,
            without_ground_point=0,
            images="images",
            dom="dom.tif",
        )
        for scene in scenes
    )
    file = BenchmarkFile(
        schema=1,
        name=chosen.benchmark,
        version=1,
        title=chosen.title,
        gallery=chosen.gallery,
        ground_truth=chosen.ground_truth,
        scenes=entries,
        checksums={},
    )
    write_benchmark_file(folder, file)
    return folder


def made_truth(scene: MadeScene) -> RetrievalTruth:
    """Return the truth of a made scene; every footprint's centre is that of tile 0."""
    n = len(scene.positives)
    lon = 113 + np.arange(scene.n_tiles) * TILE_SIZE_DEG
    tiles = pd.DataFrame(
        {
            "id": scene.tile_ids,
            "size_px": 512,
            "x": np.arange(scene.n_tiles) * 256,
            "y": 0,
            "width": 512,
            "height": 512,
            "size_m": 100.0,
            "lon_min": lon,
            "lat_min": 28.0,
            "lon_max": lon + TILE_SIZE_DEG,
            "lat_max": 28.0 + TILE_SIZE_DEG,
        }
    )
    queries = pd.DataFrame(
        {
            "id": scene.query_ids,
            "image": [f"q{q:05d}.jpg" for q in range(n)],
            "footprint_lon": 113 + TILE_SIZE_DEG / 2,
            "footprint_lat": 28 + TILE_SIZE_DEG / 2,
            **scene.conditions,
        }
    )
    counts = np.array([len(found) for found in scene.positives], dtype=np.int64)
    flat = np.array([t for found in scene.positives for t in sorted(found)], dtype=np.int32)
    excluded = pd.DataFrame({"id": [], "image": [], "reason": []}, dtype=str)
    positives = Positives(offsets_of(counts), flat)
    return RetrievalTruth(scene.id, queries, tiles, positives, excluded)


def write_predictions(path: Path, name: str, **arrays: Any) -> Path:
    """Write a prediction file of the retrieval track."""
    np.savez(path, protocol=np.array(name), **{key: np.array(v) for key, v in arrays.items()})
    return path
