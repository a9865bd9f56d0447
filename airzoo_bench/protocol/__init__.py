"""Protocols: their model, and how they are found."""
