"""Evaluation suite for aerial 3D vision: retrieval, cross-view matching, reconstruction."""

__version__ = "0.1.0.dev0"
