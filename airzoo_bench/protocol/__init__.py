"""Protocols: their model, how they are found, and which one predictions are of."""
