"""Triangles of trees: irregular canopies on trunks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.mini.landscape.building_mesh import joined
from airzoo_bench.mini.landscape.plan import Tree
from airzoo_bench.mini.landscape.randomness import hash_of
from airzoo_bench.mini.world import Material, Mesh

__all__ = ["tree_mesh"]

_STREAM = 31
_Indices = NDArray[np.int64]


def tree_mesh(trees: Sequence[Tree], ground: Floats, seed: int) -> Mesh:
    """Mesh trees; the owner of a triangle is the tree's place in the list.

    Parameters
    ----------
    trees : sequence of T trees
    ground : (T,) float64
        Height of the land under each.
    seed : int
    """
    kinds = np.array([tree.kind for tree in trees])
    parts = []
    for kind in ("broad", "cone", "bush", "bale"):
        chosen = np.flatnonzero(kinds == kind)
        if chosen.size:
            parts.append(
                _canopies([trees[i] for i in chosen.tolist()], chosen, ground[chosen], kind, seed)
            )
    tall = np.flatnonzero((kinds == "broad") | (kinds == "cone"))
    parts.append(_trunks([trees[i] for i in tall.tolist()], tall, ground[tall]))
    return joined(parts)


def _canopies(
    trees: Sequence[Tree], owners: _Indices, ground: Floats, kind: str, seed: int
) -> Mesh:
    sphere, table = _refined(*(_icosahedron() if kind == "broad" else _octahedron()))
    radius = np.array([tree.radius_m for tree in trees])
    half = _half_height(trees, kind)
    height = np.array([tree.height_m for tree in trees])
    shape = np.broadcast_to(sphere, (len(trees), *sphere.shape)) * _bumps(
        seed, owners, len(sphere), kind
    )
    if kind == "cone":
        shape = shape * np.stack([1.0 - 0.6 * shape[..., 2]] * 2 + [np.ones(shape.shape[:2])], -1)
    if kind == "bale":
        shape = np.clip(shape, [-1, -1, -0.55], [1, 1, 0.55])
    scale = np.stack([radius, radius, half], -1)[:, None, :]
    centre = np.stack([_axis(trees, "x"), _axis(trees, "y"), ground + height - half], -1)
    vertices = centre[:, None, :] + shape * scale
    return _mesh(vertices, table, owners, Material.CANOPY)


def _half_height(trees: Sequence[Tree], kind: str) -> Floats:
    height = np.array([tree.height_m for tree in trees])
    radius = np.array([tree.radius_m for tree in trees])
    if kind == "broad":
        return np.minimum(0.42 * height, 1.1 * radius)
    return height * {"cone": 0.46, "bush": 0.6, "bale": 0.9}[kind]


def _bumps(seed: int, owners: _Indices, count: int, kind: str) -> Floats:
    if kind == "bale":
        return np.ones((len(owners), count, 1))
    bits = hash_of(seed, _STREAM, owners[:, None], np.arange(count)[None, :]) >> np.uint64(44)
    return (0.72 + 0.5 * (bits.astype(np.float64) / (1 << 20)))[..., None]


def _trunks(trees: Sequence[Tree], owners: _Indices, ground: Floats) -> Mesh:
    half = np.array([0.1 + 0.05 * tree.radius_m for tree in trees])
    top = ground + np.array([0.62 * tree.height_m for tree in trees])
    x, y = _axis(trees, "x"), _axis(trees, "y")
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    corners = [
        np.stack([x + a * half, y + b * half, z], -1) for z in (ground - 0.4, top) for a, b in signs
    ]
    table = np.array(
        [(0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7)]
    )
    return _mesh(np.stack(corners, 1), table, owners, Material.TRUNK)


def _axis(trees: Sequence[Tree], name: str) -> Floats:
    return np.array([getattr(tree, name) for tree in trees], np.float64)


def _mesh(vertices: Floats, table: _Indices, owners: _Indices, material: Material) -> Mesh:
    count, corners = vertices.shape[:2]
    triangles = table[None] + (np.arange(count) * corners)[:, None, None]
    return Mesh(
        vertices.reshape(-1, 3),
        triangles.reshape(-1, 3).astype(np.int32),
        np.full(count * len(table), material, np.uint8),
        np.repeat(owners, len(table)).astype(np.int32),
    )


def _octahedron() -> tuple[Floats, _Indices]:
    points = np.array(
        [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64
    )
    table = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (1, 0, 5), (2, 1, 5), (3, 2, 5), (0, 3, 5)]
    return points, np.array(table)


def _icosahedron() -> tuple[Floats, _Indices]:
    golden = (1.0 + float(np.sqrt(5.0))) / 2.0
    flat = [(-1.0, golden), (1.0, golden), (-1.0, -golden), (1.0, -golden)]
    points = [(a, b, 0.0) for a, b in flat]
    points += [(0.0, a, b) for a, b in flat] + [(b, 0.0, a) for a, b in flat]
    table = [
        (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4),
        (11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8),
        (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1),
    ]  # fmt: skip
    return _unit(np.array(points)), np.array(table)


def _unit(points: Floats) -> Floats:
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    return np.asarray(points / np.sqrt(x * x + y * y + z * z)[:, None])


def _refined(points: Floats, table: _Indices) -> tuple[Floats, _Indices]:
    """Cut each triangle of a sphere into four."""
    edges = np.sort(np.concatenate([table[:, [0, 1]], table[:, [1, 2]], table[:, [2, 0]]]), axis=1)
    unique, place = np.unique(edges, axis=0, return_inverse=True)
    middles = _unit(points[unique[:, 0]] + points[unique[:, 1]])
    ab, bc, ca = place.reshape(3, -1) + len(points)
    a, b, c = table.T
    corners = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([points, middles]), np.concatenate([np.stack(t, 1) for t in corners])
