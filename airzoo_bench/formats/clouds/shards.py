"""A cloud in a folder of shards: LAS, LAZ or parquet files, each of some of its points."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.core.files import first_bytes, sha256_of
from airzoo_bench.formats.clouds.cloud import FIX_COPY, Cloud, FileCloud, refusal
from airzoo_bench.formats.clouds.las import open_las, read_projection
from airzoo_bench.formats.parquet import open_points

if TYPE_CHECKING:
    from pyproj import CRS

__all__ = ["SHARD_SUFFIXES", "open_shards", "shards_in"]

SHARD_SUFFIXES = (".las", ".laz", ".parquet")
"""Endings of files that can be shards."""
_LOOK_BYTES = 1 << 12


def open_shards(folder: Path, paths: Sequence[Path]) -> FileCloud:
    """Open the shards of a cloud as one cloud, in the order that they are given in."""
    files = tuple(_opened(path) for path in paths)
    _check_once([file.path for file in files if file.count])
    _check_same_crs([path for path in paths if path.suffix.lower() != ".parquet"])
    kinds = " and ".join(sorted({file.kind for file in files}))
    return FileCloud(
        folder,
        f"{kinds} in {counted(len(files), 'shard')}",
        sum(file.count for file in files),
        partial(_pieces, files),
        min((file.precision for file in files), key=lambda dtype: dtype.itemsize),
        tuple(f"{file.path.name}: {note}" for file in files for note in file.notes),
    )


def shards_in(folder: Path) -> list[Path]:
    """Return the files of a folder that can be shards, by name."""
    found = (path for path in folder.iterdir() if path.name.lower().endswith(SHARD_SUFFIXES))
    paths = sorted(path for path in found if not path.name.startswith("."))
    if not paths:
        raise refusal(folder, "holds no shard", expected=f"files {', '.join(SHARD_SUFFIXES)}")
    return paths


def _opened(path: Path) -> FileCloud:
    if not path.is_file():
        raise refusal(path, "no such shard", expected="all shards of the cloud")
    if not path.stat().st_size:
        raise refusal(path, "is empty: not even a header", fix=FIX_COPY)
    is_parquet = path.suffix.lower() == ".parquet"
    file = open_points(path) if is_parquet else open_las(path)
    return replace(file, read=partial(_while_there, file))


def _while_there(file: FileCloud, points: int) -> Iterator[Cloud]:
    try:
        yield from file.pieces(points)
    except FileNotFoundError as error:
        raise refusal(
            file.path,
            f"is not there any more, or not seen from {socket.gethostname()}",
            expected="all shards where all workers see them, for as long as the run takes",
        ) from error


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


def _check_once(paths: list[Path]) -> None:
    """Refuse a copy of a shard, and one in two formats: their points would count twice."""
    begun: dict[tuple[int, bytes], list[Path]] = {}
    names: dict[str, Path] = {}
    for path in paths:
        if names.setdefault(path.stem, path) is not path:
            raise _twice(path, f"has the name of {names[path.stem].name}, but for its ending")
        alike = begun.setdefault((path.stat().st_size, first_bytes(path, _LOOK_BYTES)), [])
        for other in alike:
            if sha256_of(other) == sha256_of(path):
                raise _twice(path, f"holds what {other.name} holds")
        alike.append(path)


def _twice(path: Path, what: str) -> PredictionError:
    return refusal(
        path,
        what,
        expected="each part of the cloud in one shard",
        fix="take one of the two away, or rename it if their points are others",
    )


def _check_same_crs(paths: list[Path]) -> None:
    stating = [(path, stated) for path in paths if (stated := read_projection(path))]
    for path, stated in stating[1:]:
        first, others = stating[0]
        if stated != others and _crs(path) != _crs(first):
            raise refusal(
                path,
                f"states another CRS than {first.name} beside it",
                expected="shards of one cloud, all in the CRS of the scene",
                fix="convert it, e.g. with pdal translate",
            )


def _crs(path: Path) -> CRS | None:
    import laspy
    from laspy.errors import LaspyException
    from pyproj.exceptions import CRSError

    try:
        with laspy.open(path, read_evlrs=False) as reader:
            stated: CRS | None = reader.header.parse_crs()
            return stated
    except (LaspyException, CRSError, ValueError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise refusal(path, f"its CRS cannot be read: {reason}") from error
