"""Three methods a track on the demo, made of the truth and noise, and their results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

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


@dataclass(frozen=True)
class Scored:
    """Three methods on a track; `paths` are in the order of `NAMES`."""

    track: str
    paths: tuple[Path, ...]

    @property
    def results(self) -> dict[str, Result]:
        return {name: read_result(path) for name, path in zip(NAMES, self.paths, strict=True)}

    @property
    def records(self) -> pd.DataFrame:
        """The records of the best method."""
        return pd.read_csv(self.paths[-1].parent / "records.csv")

    @property
    def headline(self) -> list[ScoreColumn]:
        return [column for column in read_result(self.paths[0]).columns if column.headline]

    @property
    def scene(self) -> str:
        """The last scene's id."""
        return list(read_result(self.paths[0]).scenes)[-1]


def demo() -> Benchmark:
    """Return the benchmark that ships with the package."""
    return find_benchmark("airzoo-demo", Path())


def score_methods(factory: pytest.TempPathFactory, track: str) -> Scored:
    """Write predictions of growing quality and score them as a user does."""

    def make(out: Path) -> None:
        for quality, name in enumerate(NAMES):
            (out / f"{quality}-given").mkdir()
            path = _cloud(demo(), quality, out / f"{quality}-given")
            ask = ("eval", track, path, "--method", name, "--out", out / str(quality))
            assert run_main(*ask) == 0

    def make_rows(out: Path) -> None:
        rows = _rank if track == "retrieval" else _pose
        for quality, name in enumerate(NAMES):
            ids, values = zip(*rows(demo(), np.random.default_rng(quality), quality), strict=True)
            field = "ranked_ids" if track == "retrieval" else "poses"
            fields = {"query_ids": np.concatenate(ids), field: np.concatenate(values)}
            np.savez(out / "p.npz", protocol=f"airzoo-demo-{track}", **fields)
            ask = ("eval", track, out / "p.npz", "--method", name, "--out", out / str(quality))
            assert run_main(*ask) == 0

    made = made_once(factory, f"demo-{track}", make if track == "reconstruction" else make_rows)
    return Scored(track, tuple(made / str(n) / "result.json" for n in range(len(NAMES))))


def _rank(benchmark: Benchmark, random: np.random.Generator, quality: int) -> Iterator[Any]:
    """Order tiles by noise, and positive ones by something more."""
    for scene in benchmark.file.scenes:
        truth = read_retrieval(benchmark.scene_folder(scene.id), scene.id)
        tiles = truth.tiles["id"].to_numpy(str)
        scores = random.normal(size=(len(truth.queries), len(tiles)))
        for row, line in enumerate(scores):
            line[truth.positives.of_query(row)] += 0.8 * quality
        yield truth.queries["id"].to_numpy(str), tiles[np.argsort(-scores, axis=1)[:, :20]]


def _pose(benchmark: Benchmark, random: np.random.Generator, quality: int) -> Iterator[Any]:
    """Move the true poses by metres, and give some queries none."""
    for scene in benchmark.file.scenes:
        truth = read_matching(benchmark, scene.id)
        noise = random.normal(0, (6.0, 2.0, 0.6)[quality], (len(truth.queries), 3))
        moved = truth.poses.translation + noise
        found = np.concatenate([truth.poses.rotation, moved[..., None]], axis=2)
        found[random.random(len(found)) < (0.6, 0.2, 0.0)[quality]] = np.nan
        yield truth.queries["id"].to_numpy(str), found


def _cloud(benchmark: Benchmark, quality: int, home: Path) -> Path:
    """Take a share of the true points and move them."""
    random = np.random.default_rng(quality)
    folder = home / "clouds"
    folder.mkdir()
    (folder / "protocol.txt").write_text(f"{benchmark.file.name}-reconstruction")
    for scene in (one.id for one in benchmark.file.scenes):
        truth = read_reconstruction(benchmark, scene)
        cloud = open_cloud(truth.cloud, limit_bytes=1 << 30, sampling=None)
        points = np.concatenate([piece.points for piece in cloud.pieces(1 << 20)])
        points = points[:: (500, 50, 10)[quality]]
        noise = random.normal(0, (2.0, 0.5, 0.1)[quality], points.shape)
        np.save(folder / f"{scene}.npy", points + noise)
        poses = truth.poses
        np.savez(
            folder / f"{scene}.cameras.npz",
            image_names=truth.photos["image"].to_numpy(str),
            extrinsics=np.concatenate([poses.rotation, poses.translation[..., None]], axis=2),
        )
    return folder
