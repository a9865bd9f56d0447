"""Scores, result files and records; which results may stand side by side."""
