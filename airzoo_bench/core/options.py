"""Options of the command line that plug-ins such as datasets and baselines have."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Option"]


@dataclass(frozen=True)
class Option:
    """A field of a settings dataclass whose annotation carries this is an option of the command.

    Such as ``pixels: Annotated[int, Option("pixels", "Of the longer side.", least=64)] = 640``;
    a field without a default is an option that must be given.

    Attributes
    ----------
    name : str
        Without its hyphens; where the field is a bool, ``--no-`` before it turns it off.
    help : str
    least, most : float, optional
        What may be asked for.
    """

    name: str
    help: str
    least: float | None = None
    most: float | None = None
