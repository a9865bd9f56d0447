"""Galleries of tiles, and positives found by testing every tile."""

from __future__ import annotations

import numpy as np

UNIT_BOX = np.array([[0.0, 0, 1, 1]])


def naive(points, boxes):
    """Test every point against every tile."""
    lon, lat = points[:, :, None, 0], points[:, :, None, 1]
    inside = (boxes[:, 0] <= lon) & (lon <= boxes[:, 2])
    inside &= (boxes[:, 1] <= lat) & (lat <= boxes[:, 3])
    return [np.flatnonzero(row) for row in inside.any(axis=1)]


def assert_same(found, expected):
    assert found.tiles.dtype == np.int32
    assert found.offsets.dtype == np.int64
    assert found.n_queries == len(expected)
    assert found.counts.tolist() == [len(tiles) for tiles in expected]
    assert found.tiles.tolist() == [tile for tiles in expected for tile in tiles]


def starts_of(length, tile):
    """Tiles at half a tile's stride; the last anchored to the edge."""
    starts = np.arange(0, max(length - tile, 0) + 1, tile / 2)
    return starts if starts[-1] >= length - tile else np.append(starts, length - tile)


def grid(width, height, tile, place=lambda x, y: (x, y)):
    """Boxes of the corners of a map's tiles, row by row from the north."""
    x, y = np.meshgrid(starts_of(width, tile), -starts_of(height, tile))
    corners = [place(x + dx, y - dy) for dx in (0, tile) for dy in (0, tile)]
    lon, lat = np.stack([c[0] for c in corners]), np.stack([c[1] for c in corners])
    sides = lon.min(axis=0), lat.min(axis=0), lon.max(axis=0), lat.max(axis=0)
    return np.stack(sides, axis=-1).reshape(-1, 4)


def tilted(x, y):
    """Tilt and bend a map as the convergence of the meridians does, only more."""
    return 112 + x + 0.05 * y + 2e-4 * x * y, 28 + y - 0.05 * x - 1e-4 * x**2


def two_scales(width, height, place=lambda x, y: (x, y)):
    return np.concatenate([grid(width, height, tile, place) for tile in (4.0, 2.0)])


def points_near(boxes, rng, n, per_query=4):
    """Points in, on the borders and corners of, and beside tiles, and some NaN."""
    picks = boxes[rng.integers(0, len(boxes), (n, per_query))]
    share = rng.choice([0, 0, 0.25, 0.5, 1, 1, 1.5, np.nan], (n, per_query, 2))
    low, high = picks[..., :2], picks[..., 2:]
    return np.where(share == 0, low, np.where(share == 1, high, low + share * (high - low)))
