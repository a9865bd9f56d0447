"""Result objects that people look at: lines in a terminal, a table in a notebook."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Mapping


class Shown(ABC):
    """Shows its most important fields, a line each; for dataclasses with ``repr=False``."""

    @abstractmethod
    def _display_fields(self) -> Mapping[str, object]:
        """Return what to show, by name."""

    def __repr__(self) -> str:
        rows = self._display_fields()
        width = max(map(len, rows), default=0)
        lines = [f"  {name:<{width}}  {value}" for name, value in rows.items()]
        return "\n".join([type(self).__name__, *lines])

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{html.escape(name)}</th><td>{html.escape(str(value))}</td></tr>"
            for name, value in self._display_fields().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"


def number(value: float) -> str:
    """Write a number with four decimals, as all of these objects do."""
    return f"{value:.4f}"
