"""The world: how a region is laid out, painted, meshed, lit, and kept on disk."""
