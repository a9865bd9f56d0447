"""Endings of files that can be clouds or meshes."""

from __future__ import annotations

__all__ = ["GZIPPED_SUFFIXES", "KINDS", "SUFFIXES", "TEXT_SUFFIXES"]

TEXT_SUFFIXES = (".xyz", ".txt", ".csv", ".asc", ".pts")
_MESHES = (".obj", ".stl", ".off", ".gltf", ".glb")
_PLAIN = (".ply", ".pcd", ".las", ".laz", ".npz", ".npy", *TEXT_SUFFIXES, *_MESHES)
_UNZIPPED = (".laz", ".npz")
GZIPPED_SUFFIXES = tuple(f"{suffix}.gz" for suffix in _PLAIN if suffix not in _UNZIPPED)
SUFFIXES = (*_PLAIN, *GZIPPED_SUFFIXES)
"""All of them."""
KINDS = f"{', '.join(_PLAIN)}, and .gz of them"
"""The same, for people."""
