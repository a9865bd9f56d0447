"""Point clouds and meshes in the formats that people write them in, read as hostile input."""

TEXT_SUFFIXES = (".xyz", ".txt", ".csv", ".asc", ".pts")
_POINTS = (".ply", ".pcd", ".las", ".laz", ".npz", ".npy", *TEXT_SUFFIXES)
SUFFIXES = (*_POINTS, ".obj", ".gltf", ".glb")
"""Endings of files that can be clouds or meshes."""
KINDS = ", ".join(SUFFIXES)
"""The same, for people."""
