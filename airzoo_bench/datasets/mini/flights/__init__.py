"""Flights over a region: made here, read from files, thinned to key frames."""
