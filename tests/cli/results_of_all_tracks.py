"""The demo, and a prediction of its clouds made of the truth and noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.formats.clouds.cloud import open_cloud
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction

TRACKS = ("retrieval", "matching", "reconstruction")


def demo() -> Benchmark:
    """Return the benchmark that ships with the package."""
    return find_benchmark("airzoo-demo", Path())


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
