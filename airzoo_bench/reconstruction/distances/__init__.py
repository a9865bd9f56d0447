"""Exact distances between clouds, in memory or in blocks."""
