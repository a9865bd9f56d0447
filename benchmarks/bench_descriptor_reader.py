"""Descriptors as VPR-methods-evaluation leaves them, beside the suite's own file of the same rows.

Usage: ``python benchmarks/bench_descriptor_reader.py [--tiles 600000] [--dimensions 8448]``

``eval retrieval`` in a process of its own on each: a log folder whose listings name the rows, and
an ``.npz`` that holds their ids. With few dimensions it is the names alone that cost. The disk
holds one of the two at a time.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple
from unittest import mock

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.hostile.peak import run
from tests.support import MadeScene, made_protocol, write_benchmark

BLOCK_BYTES = 1 << 26
TILE_SIZE_DEG = 1e-4  # so that 600,000 in a row end before the 180th meridian
Rows = NDArray[np.float32]


class Scene(MadeScene):
    """A scene of more tiles than five digits number, whose ids are still in order."""

    def tile(self, number: int) -> str:
        """Return the id of a tile."""
        return f"{self.id}/t{number:07d}"


class Cost(NamedTuple):
    """What a process took."""

    wall: float
    processor: float
    peak_mb: float


def blocks(tiles: int, dimensions: int) -> Iterator[Rows]:
    """Yield the gallery's rows, the same ones each time."""
    random = np.random.default_rng(0)
    step = max(1, BLOCK_BYTES // (4 * dimensions))
    for start in range(0, tiles, step):
        yield random.standard_normal((min(step, tiles - start), dimensions), np.float32)


def write_rows(stream: IO[bytes], tiles: int, dimensions: int) -> None:
    """Write the gallery as ``.npy``."""
    header = {"descr": "<f4", "fortran_order": False, "shape": (tiles, dimensions)}
    np.lib.format.write_array_header_1_0(stream, header)
    for rows in blocks(tiles, dimensions):
        stream.write(rows.data)


def write_log(root: Path, scene: MadeScene, asked: Rows) -> Path:
    """Write a log folder with the listings of its images."""
    log, images = root / "logs" / scene.id / "2026-11-22_19-00-00", root / "logs" / "images"
    for kind, ids, ending in (
        ("database", scene.tile_ids, "png"),
        ("queries", scene.query_ids, "jpg"),
    ):
        (images / kind).mkdir(parents=True)
        lines = "".join(f"{one.split('/')[1]}.{ending}\n" for one in ids)
        (images / f"{kind}_images_paths.txt").write_text(lines)
    log.mkdir(parents=True)
    (log / "info.log").write_text(
        f"Namespace(method='salad', database_folder='{images / 'database'}', "
        f"queries_folder='{images / 'queries'}')\n"
    )
    np.save(log / "queries_descriptors.npy", asked)
    with (log / "database_descriptors.npy").open("wb") as stream:
        write_rows(stream, scene.n_tiles, asked.shape[1])
    return log


def write_npz(root: Path, scene: MadeScene, asked: Rows) -> Path:
    """Write the canonical file."""
    path = root / "preds.npz"
    ids = {"query_ids": scene.query_ids, "gallery_ids": scene.tile_ids}
    np.savez(path, protocol=np.array("made-retrieval"), query_descriptors=asked, **ids)
    member = "gallery_descriptors.npy"
    with zipfile.ZipFile(path, "a") as file, file.open(member, "w", force_zip64=True) as stream:
        write_rows(stream, scene.n_tiles, asked.shape[1])
    return path


def measured(path: Path, root: Path, memory: str) -> tuple[Cost, bytes]:
    """Score predictions, and return what that took and the records."""
    out, data = root / f"results-of-{path.stem}", root / "data"
    protocol = data / "made" / "protocols" / "made-retrieval.toml"
    given = ("--protocol", protocol, "--out", out, "--max-memory", memory, "--method", "Example")
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    ended = run("eval", "retrieval", path, *given, data=data, seconds=3600)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if ended.code:
        raise SystemExit(ended.said)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(wall, used, ended.peak / 1e6), (out / "records.csv").read_bytes()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tiles", type=int, default=600_000)
    parser.add_argument("--dimensions", type=int, default=8_448)
    parser.add_argument("--queries", type=int, default=40)
    parser.add_argument("--max-memory", default="500M")
    options = parser.parse_args()
    tiles, dimensions = options.tiles, options.dimensions
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        scene = Scene("s", [[tile] for tile in range(options.queries)], tiles)
        with mock.patch("tests.support.TILE_SIZE_DEG", TILE_SIZE_DEG):
            write_benchmark(root / "data" / "made", made_protocol([scene]), [scene])
        noise = np.random.default_rng(1).standard_normal((options.queries, dimensions), np.float32)
        asked = next(blocks(tiles, dimensions))[: options.queries] + noise
        found = {}
        for label, write in (("log folder", write_log), ("npz", write_npz)):
            path = write(root, scene, asked)
            found[label] = measured(path, root, options.max_memory)
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    print(f"{tiles:,} tiles, {dimensions:,} numbers each, {options.queries} queries\n")
    print(f"{'':12}{'seconds':>9}{'processor':>11}{'peak MB':>9}")
    for label, (cost, _) in found.items():
        print(f"{label:12}{cost.wall:9.2f}{cost.processor:11.2f}{cost.peak_mb:9.0f}")
    (ours, records), (theirs, others) = found.values()
    ratios = [one / other for one, other in zip(ours, theirs, strict=True)]
    print(f"{'ratio':12}{ratios[0]:9.2f}{ratios[1]:11.2f}{ratios[2]:9.2f}")
    print(f"\nsame records: {'yes' if records == others else 'no'}")


if __name__ == "__main__":
    main()
