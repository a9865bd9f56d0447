"""Distances between a predicted and a true cloud, in memory where they fit, in blocks where not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.distances.blocks import block_distances
from airzoo_bench.reconstruction.distances.neighbours import mutual_distances
from airzoo_bench.reconstruction.regions import finite_rows

__all__ = ["CloudDistances", "cloud_distances"]


@dataclass(frozen=True, eq=False)
class CloudDistances:
    """Nearest distances both ways, infinite where nothing is predicted.

    Attributes
    ----------
    to_truth : (P,) float64
        From each finite predicted point to the true cloud, in the order of the source.
    to_prediction : (T,) float64
        From each finite true point to the predicted cloud.
    """

    to_truth: Floats
    to_prediction: Floats


def cloud_distances(
    prediction: CloudSource,
    truth: CloudSource,
    *,
    block_points: int,
    threads: int,
    folder: Path | None,
    progress: Progress = silent,
) -> CloudDistances:
    """Exact nearest distances between two clouds, both ways.

    Parameters
    ----------
    prediction, truth : CloudSource
        Points that are not finite are left out.
    block_points : int
        Clouds that both have at most so many points are held in memory; larger ones are worked in
        blocks of about so many. The distances do not depend on it.
    threads : int
        At least 1; the distances do not depend on it.
    folder : Path or None
        For temporary files of large clouds, 32 bytes a point; by default the system's.
    progress : Progress

    Returns
    -------
    CloudDistances

    Raises
    ------
    BenchmarkError
        The true cloud has no finite point.
    UserError
        Temporary files cannot be written; what the sources raise.
    """
    first, second = (partial(_pieces, source, block_points) for source in (prediction, truth))
    counts = prediction.count, truth.count
    if max(counts) <= block_points:
        predicted, true = _all(first()), _all(second())
        _require_truth(len(true) > 0)
        return CloudDistances(*mutual_distances(predicted, true, threads=threads))
    _require_truth(_any(second()))
    if not _any(first()):
        return CloudDistances(np.zeros(0), np.full(sum(map(len, second())), np.inf))
    return CloudDistances(
        *block_distances(
            first,
            second,
            counts=counts,
            block_points=block_points,
            threads=threads,
            folder=folder,
            progress=progress,
        )
    )


def _pieces(source: CloudSource, points: int) -> Iterator[Floats]:
    for piece in source.pieces(points):
        finite = finite_rows(piece.points)
        yield piece.points if finite.all() else piece.points[finite]


def _all(pieces: Iterator[Floats]) -> Floats:
    return np.concatenate([np.zeros((0, 3)), *pieces])


def _any(pieces: Iterator[Floats]) -> bool:
    return any(len(piece) for piece in pieces)


def _require_truth(there: bool) -> None:
    if not there:
        raise BenchmarkError(
            "the true cloud holds no finite point",
            expected="at least one point, after cropping too",
            fix="check the benchmark's cloud and the protocol's crop",
        )
