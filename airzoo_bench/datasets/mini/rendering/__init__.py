"""Rendering: photos of a world with exact depth, in every weather and light."""
