"""The answer of functions on arrays: scores by name, and the arrays that they come from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["Scores"]


class Scores:
    """Scores by name, as items and attributes: ``found["recall@1"]``, ``found.f1``.

    It shows itself as a list of its scores; the function that returns it says what it has.

    Parameters
    ----------
    scores : mapping of str to float, int, str or None
        What is shown, with four decimals.
    **more : object
        Further attributes, such as the table or the arrays that scores are made of.
    """

    def __init__(self, scores: Mapping[str, Any], **more: Any) -> None:
        self.scores = dict(scores)
        vars(self).update(more)

    def __getitem__(self, name: str) -> Any:
        return self.scores[name]

    def __getattr__(self, name: str) -> Any:
        if name == "scores" or name not in self.scores:
            raise AttributeError(f"there is no {name!r} among {', '.join(vars(self))}")
        return self.scores[name]

    def __repr__(self) -> str:
        rows = {n: f"{v:.4f}" if isinstance(v, float) else v for n, v in self.scores.items()}
        width = max(map(len, rows), default=0)
        return "\n".join(["Scores", *(f"  {name:<{width}}  {v}" for name, v in rows.items())])
