"""Cameras, poses, frames, rays and rasters; knows nothing of tracks or files of predictions."""
