"""Endings of files that can be clouds or meshes."""

from __future__ import annotations

TEXT_SUFFIXES = (".xyz", ".txt", ".csv", ".asc", ".pts")
_POINTS = (".ply", ".pcd", ".las", ".laz", ".npz", ".npy", *TEXT_SUFFIXES)
SUFFIXES = (*_POINTS, ".obj", ".gltf", ".glb")
"""All of them."""
KINDS = ", ".join(SUFFIXES)
"""The same, for people."""
