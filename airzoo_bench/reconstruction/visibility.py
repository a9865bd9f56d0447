"""Which part of the true cloud the photos saw: inside enough of them, and not hidden.

Recall is over this part where a protocol asks for it.
"""

from __future__ import annotations

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, counted
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.cloud_sources import finite_pieces
from airzoo_bench.reconstruction.regions import Box, CellSet, occupied_cells
from airzoo_bench.reconstruction.settings import Preparation

__all__ = ["observed_cells", "seen_by"]

_NEAREST = 1e-3
# A cell of the depth buffer is this many projected cells wide, so that surfaces have no holes.
_SPLAT = 1.5
_STEP = np.sqrt(2.0)


def observed_cells(
    truth: CloudSource,
    box: Box,
    cameras: Cameras,
    poses: Poses,
    settings: Preparation,
    block_points: int,
) -> CellSet:
    """Cells of the true cloud, which `box` holds, that enough of the photos saw."""
    cell = settings.observed_cell_m
    # Thinning rounds: points may lie outside the box of the unthinned cloud by a hair.
    sides = (cell, cell, cell)
    occupied = occupied_cells(finite_pieces(truth, block_points), sides, box, cell)
    points, times = occupied.centres(), np.zeros(len(occupied.keys), np.int64)
    for row in range(len(poses)):
        camera, pose = cameras.take(row), poses.take(row)
        times += seen_by(points, camera, pose, cell, settings.hidden_beyond_m)
    keys = occupied.keys[times >= settings.observed_photos]
    if not len(keys):
        raise BenchmarkError(
            f"no point of the true cloud is seen by {counted(settings.observed_photos, 'photo')}",
            expected="a cloud of what the photos show, in the same coordinates",
            fix='check poses and cloud, or choose region = "all" in the protocol',
        )
    return CellSet(occupied.size, occupied.low, occupied.shape, keys)


def seen_by(
    points: Floats, camera: Cameras, pose: Poses, cell: float, hidden_beyond: float
) -> Bools:
    """Whether a photo sees each of points (N, 3): centres of the cells that a surface occupies."""
    seen = np.zeros(len(points), np.bool_)
    local = apply_matrix(pose.rotation[0], points - pose.centres[0])
    rows = np.flatnonzero(local[:, 2] > _NEAREST)
    pixels = project(camera, local[None, rows])[0]
    size = np.array((camera.width[0], camera.height[0]))
    inside = ((pixels >= 0.0) & (pixels < size)).all(axis=1)
    rows, pixels = rows[inside], pixels[inside]
    depth = local[rows, 2]
    wide = _SPLAT * cell * float(camera.focal[0].max()) / depth
    levels = np.ceil(np.log(np.maximum(wide, 1.0)) / np.log(_STEP)).astype(np.int64)
    seen[rows] = ~_hidden(pixels, depth, levels, size, hidden_beyond)
    return seen


def _hidden(pixels: Floats, depth: Floats, levels: Ints, size: Ints, beyond: float) -> Bools:
    """Test points against all nearer ones; those need buffers of wider cells."""
    hidden = np.zeros(len(depth), np.bool_)
    for level in np.unique(levels).tolist():
        side = _STEP**level
        columns = int(size[0] // side) + 1
        x, y = np.floor(pixels / side).astype(np.int64).T
        place = y * columns + x
        nearest = np.full(columns * (int(size[1] // side) + 1), np.inf)
        own = levels == level
        np.minimum.at(nearest, place[own], depth[own])
        tested = levels <= level
        hidden[tested] |= nearest[place[tested]] < depth[tested] - beyond
    return hidden
