"""The evaluation script."""

from .main import evaluate

__all__ = ["evaluate"]
