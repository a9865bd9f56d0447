"""The true cloud of a scene: a file or a folder of shards, whose errors are the benchmark's."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, PredictionError
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.formats.clouds.meshes import MeshSampling
from airzoo_bench.formats.clouds.shards import open_shards, shards_in

__all__ = ["open_true_cloud"]


def open_true_cloud(path: Path, memory_bytes: int, sampling: MeshSampling) -> CloudSource:
    """Open the true cloud."""
    with _blamed(path):
        if path.is_dir():
            return _TrueCloud(path, open_shards(path, shards_in(path)))
        return _TrueCloud(path, open_cloud(path, limit_bytes=memory_bytes, sampling=sampling))


@dataclass(frozen=True, eq=False)
class _TrueCloud:
    path: Path
    source: CloudSource

    @property
    def count(self) -> int:
        return self.source.count

    def pieces(self, points: int) -> Iterator[Cloud]:
        with _blamed(self.path):
            yield from self.source.pieces(points)


@contextmanager
def _blamed(path: Path) -> Iterator[None]:
    try:
        yield
    except PredictionError as error:
        raise BenchmarkError(
            f"the true cloud cannot be read: {error.what}",
            where=error.where or path,
            expected=error.expected,
            fix="prepare the benchmark with a cloud that is whole",
        ) from error
