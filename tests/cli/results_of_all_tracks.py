"""Three methods a track, made of the truth and noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.results.result import Result, ScoreColumn, read_result
from airzoo_bench.retrieval.truth import read_truth as read_retrieval
from tests.shared import made_once
from tests.support import run_main

TRACKS = ("retrieval", "matching", "reconstruction")
# From bad to good, with what formats must escape.
NAMES = ("weak_1 & co", "fair #2", "good 90 %")

_MEMORY = 1 << 30


# --- results ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Scored:
    """Three methods on a track of the demo; `paths` are in the order of `NAMES`."""

    track: str
    paths: tuple[Path, ...]

    @property
    def results(self) -> dict[str, Result]:
        return {name: read_result(path) for name, path in zip(NAMES, self.paths, strict=True)}

    @property
    def records(self) -> dict[str, pd.DataFrame]:
        pairs = zip(NAMES, self.paths, strict=True)
        return {name: pd.read_csv(path.parent / "records.csv") for name, path in pairs}

    @property
    def headline(self) -> list[ScoreColumn]:
        return [column for column in read_result(self.paths[0]).columns if column.headline]

    @property
    def scene(self) -> str:
        """The last scene's id."""
        return list(read_result(self.paths[0]).scenes)[-1]


ScoresOf = Callable[[str], Scored]


def demo() -> Benchmark:
    """Return the benchmark that ships with the package."""
    return find_benchmark("airzoo-demo", Path())


def score_methods(factory: pytest.TempPathFactory, track: str) -> Scored:
    """Write predictions of growing quality and score them as a user does."""
    write = {"retrieval": _rank, "matching": _pose, "reconstruction": _cloud}[track]

    def make(out: Path) -> None:
        for quality, name in enumerate(NAMES):
            given = out / f"predictions-{quality}"
            given.mkdir()
            predictions = write(demo(), quality, given)
            ask = ("eval", track, predictions, "--method", name)
            assert run_main(*ask, "--out", out / str(quality)) == 0

    made = made_once(factory, f"demo-{track}", make)
    paths = tuple(made / str(quality) / "result.json" for quality in range(len(NAMES)))
    return Scored(track, paths)


def _scenes(benchmark: Benchmark) -> list[str]:
    return [scene.id for scene in benchmark.file.scenes]


def _rank(benchmark: Benchmark, quality: int, home: Path) -> Path:
    """Order tiles by noise, and positive ones by something more."""
    random = np.random.default_rng(quality)
    ids: list[str] = []
    ranked = []
    for scene in _scenes(benchmark):
        truth = read_retrieval(benchmark.scene_folder(scene), scene)
        tiles = truth.tiles["id"].to_numpy(str)
        for row, query in enumerate(truth.queries["id"]):
            score = random.normal(size=len(tiles))
            score[truth.positives.of_query(row)] += (0.0, 0.8, 1.6)[quality]
            ids.append(query)
            ranked.append(tiles[np.argsort(-score)[:20]])
    protocol = f"{benchmark.file.name}-retrieval"
    np.savez(home / "p.npz", protocol=protocol, query_ids=ids, ranked_ids=np.array(ranked))
    return home / "p.npz"


def _pose(benchmark: Benchmark, quality: int, home: Path) -> Path:
    """Move the true poses by metres, and give some queries none."""
    random = np.random.default_rng(quality)
    ids: list[str] = []
    poses = []
    for scene in _scenes(benchmark):
        truth = read_matching(benchmark, scene)
        noise = random.normal(0, (6.0, 2.0, 0.6)[quality], (len(truth.queries), 3))
        moved = truth.poses.translation + noise
        found = np.concatenate([truth.poses.rotation, moved[..., None]], axis=2)
        found[random.random(len(found)) < (0.6, 0.2, 0.0)[quality]] = np.nan
        ids += truth.queries["id"].tolist()
        poses.append(found)
    protocol = f"{benchmark.file.name}-matching"
    np.savez(home / "p.npz", protocol=protocol, query_ids=ids, poses=np.concatenate(poses))
    return home / "p.npz"


def _cloud(benchmark: Benchmark, quality: int, home: Path) -> Path:
    """Take a share of the true points and move them."""
    random = np.random.default_rng(quality)
    folder = home / "clouds"
    folder.mkdir()
    (folder / "protocol.txt").write_text(f"{benchmark.file.name}-reconstruction")
    for scene in _scenes(benchmark):
        truth = read_reconstruction(benchmark, scene)
        poses, points = truth.poses, _true_points(truth.cloud)
        points = points[:: (500, 50, 10)[quality]]
        noise = random.normal(0, (2.0, 0.5, 0.1)[quality], points.shape)
        np.save(folder / f"{scene}.npy", points + noise)
        np.savez(
            folder / f"{scene}.cameras.npz",
            image_names=truth.photos["image"].to_numpy(str),
            extrinsics=np.concatenate([poses.rotation, poses.translation[..., None]], axis=2),
        )
    return folder


def _true_points(path: Path) -> NDArray[np.float64]:
    cloud = open_cloud(path, limit_bytes=_MEMORY, sampling=None)
    return np.concatenate([piece.points for piece in cloud.pieces(1 << 20)])
