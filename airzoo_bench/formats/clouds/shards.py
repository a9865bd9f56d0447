"""A cloud in a folder of shards: LAS or LAZ files, each of some of its points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import counted
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud, refusal
from airzoo_bench.formats.clouds.las import open_las

SHARD_SUFFIXES = (".las", ".laz")
"""Endings of files that can be shards."""


def open_shards(folder: Path, paths: Sequence[Path]) -> FileCloud:
    """Open the shards of a cloud as one cloud, in the order that they are given in."""
    names = [path.stem for path in paths]
    twice = next((path for path in paths if names.count(path.stem) > 1), None)
    if twice is not None:
        raise refusal(
            twice,
            "stands there as LAS and as LAZ, and its points would count twice",
            expected="each part of the cloud in one shard",
            fix="take one of the two away, or rename it if their points are others",
        )
    files = tuple(map(open_las, paths))
    kinds = " and ".join(sorted({file.kind for file in files}))
    return FileCloud(
        folder,
        f"{kinds} in {counted(len(files), 'shard')}",
        sum(file.count for file in files),
        partial(_pieces, files),
        np.dtype(np.float64),
        tuple(f"{file.path.name}: {note}" for file in files for note in file.notes),
    )


def shards_in(folder: Path) -> list[Path]:
    """Return the files of a folder that can be shards, by name."""
    found = (path for path in folder.iterdir() if path.name.lower().endswith(SHARD_SUFFIXES))
    paths = sorted(path for path in found if not path.name.startswith("."))
    if not paths:
        raise refusal(folder, "holds no shard", expected=f"files {', '.join(SHARD_SUFFIXES)}")
    return paths


def _pieces(files: tuple[FileCloud, ...], points: int) -> Iterator[Cloud]:
    """Yield the points in pieces that end where those of one file would."""
    left = np.zeros((0, 3))
    for file in files:
        for piece in file.pieces(points):
            left = np.concatenate((left, piece.points)) if len(left) else piece.points
            while len(left) >= points:
                yield Cloud(left[:points])
                left = left[points:]
    if len(left):
        yield Cloud(left)
