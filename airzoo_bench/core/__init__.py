"""Errors, files, settings and child processes, for every room."""
