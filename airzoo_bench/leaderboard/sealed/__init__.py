"""Sealed truth: public inputs apart from it, archives that only a key opens, coarse answers."""
