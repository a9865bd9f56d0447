"""Readers of prediction files; every file is treated as hostile input."""
