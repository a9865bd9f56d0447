"""Aerial image retrieval: a UAV photo finds its satellite tile."""
