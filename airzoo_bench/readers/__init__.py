"""Readers of files as methods write them: a module a shape, methods named in `core.registry`."""
