"""Locations: what lies at a URL, mirrored, opened where it lies, or uploaded."""
