"""Cameras, poses, CRS, rasters, height fields and rays."""
