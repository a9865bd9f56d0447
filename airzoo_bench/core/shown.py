"""Result objects that people look at: a field a line, in a terminal and a notebook."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping


class Shown(ABC):
    """Shows its most important fields; for dataclasses with ``repr=False``."""

    @abstractmethod
    def _display_fields(self) -> Mapping[str, object]:
        """Return what to show, by name."""

    def __repr__(self) -> str:
        rows = self._display_fields()
        width = max(map(len, rows), default=0)
        lines = [f"  {name:<{width}}  {value}" for name, value in rows.items()]
        return "\n".join([type(self).__name__, *lines])


def number(value: float) -> str:
    """Write a number with four decimals, as all of these objects do."""
    return f"{value:.4f}"
