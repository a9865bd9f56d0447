"""What samples of the retrieval track are made from: scenes, descriptors, and their scores."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import airzoo_bench as ab
from tests.support import MadeScene, made_protocol, write_benchmark

PROTOCOL = "made-retrieval"
DIMENSIONS = 24


def made_scenes() -> list[MadeScene]:
    """Return two scenes: every query q has the tiles q and q + 1 as positives."""
    return [
        MadeScene("east", [[q, q + 1] for q in range(6)], 12),
        MadeScene("west", [[q, q + 1] for q in range(4)], 8),
    ]


@dataclass(frozen=True)
class Place:
    """Scenes with float32 descriptors of unit length, in the order of the ids.

    `noise` 0 makes every query most like its positives.
    """

    scenes: list[MadeScene] = field(default_factory=made_scenes)
    noise: float = 0.0

    def descriptors(self, scene: MadeScene) -> tuple[Any, Any]:
        """Return those of queries and of tiles."""
        random = np.random.default_rng(len(scene.id) + scene.n_tiles)
        tiles = np.linalg.qr(random.standard_normal((DIMENSIONS, DIMENSIONS)))[0][: scene.n_tiles]
        queries = np.stack([tiles[found].sum(axis=0) for found in scene.positives])
        queries = queries + self.noise * random.standard_normal(queries.shape)
        queries /= np.linalg.norm(queries, axis=1, keepdims=True)
        return queries.astype(np.float32), tiles.astype(np.float32)

    def ranked(self, scene: MadeScene) -> tuple[Any, Any]:
        """Return tile numbers, best first, and their similarities, of each query."""
        queries, tiles = (one.astype(np.float64) for one in self.descriptors(scene))
        scores = -((queries[:, None] - tiles[None]) ** 2).sum(axis=2)
        order = np.argsort(-scores, axis=1)
        return order, np.take_along_axis(scores, order, axis=1)

    def canonical(self, path: Path) -> Path:
        """Write the suite's own file of the same descriptors."""
        pairs = [self.descriptors(scene) for scene in self.scenes]
        np.savez(
            path,
            protocol=np.array(PROTOCOL),
            query_ids=np.array([one for scene in self.scenes for one in scene.query_ids]),
            gallery_ids=np.array([one for scene in self.scenes for one in scene.tile_ids]),
            query_descriptors=np.concatenate([one for one, _ in pairs]),
            gallery_descriptors=np.concatenate([one for _, one in pairs]),
        )
        return path

    def prepare(self, root: Path) -> Path:
        """Write the benchmark folder below a data root."""
        write_benchmark(root / "made", made_protocol(self.scenes), self.scenes)
        return root


def make_world(folder: Path) -> Place:
    """Write the benchmark folder, and return its scenes."""
    Place().prepare(folder / "data")
    return Place()


def tile_file(folder: str, scene: MadeScene, number: int) -> str:
    """Return where `prepare --tiles files` would have written a tile."""
    return f"{folder}/scenes/{scene.id}/retrieval/tiles/t{number:05d}.png"


def photo_file(folder: str, scene: MadeScene, number: int) -> str:
    return f"{folder}/{scene.id}/photos/q{number:05d}.jpg"


def scored(path: Path, data: Path, **given: Any) -> ab.Result:
    return ab.evaluate(path, protocol=PROTOCOL, data=data, **given)


def perfect(result: Any) -> bool:
    return bool(result.overall["recall@1"] == 1.0 and result.overall["map"] == 1.0)


PLENTY = 1 << 30
