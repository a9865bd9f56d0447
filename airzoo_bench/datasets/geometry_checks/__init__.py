"""Checks of a dataset's geometry: frames, depth against poses, splits against each other."""
