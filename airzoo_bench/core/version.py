"""The version of the suite, which results and pictures state."""

__all__ = ["__version__"]

__version__ = "0.1.0.dev0"
