"""Scores, result files and their records; comparisons of methods."""
