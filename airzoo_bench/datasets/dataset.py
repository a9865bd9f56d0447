"""What `prepare` can make a benchmark folder of; `core.registry.DATASETS` names them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["Dataset"]


@dataclass(frozen=True)
class Dataset:
    """A kind of data, such as own photos, or a benchmark as it is downloaded.

    Attributes
    ----------
    prepare : callable
        Makes the folder. Its parameters, annotated as Typer reads them, are the options of the
        command, and its docstring is the command's help.
    example : str
        What stands behind ``airzoo-bench prepare``, for the help.
    """

    prepare: Callable[..., None]
    example: str
