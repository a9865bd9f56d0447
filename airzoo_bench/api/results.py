"""Results of evaluations, read back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.api.arrays import path_of
from airzoo_bench.results.files import results_here
from airzoo_bench.results.records import Scored, read_scored
from airzoo_bench.storage.urls import is_url
from airzoo_bench.tables.layouts import scenes_table
from airzoo_bench.tables.model import Table
from airzoo_bench.tables.render import render

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Result", "Tabular", "load_result"]

_WIDTH = 120


class Tabular(ABC):
    """Shows itself as a table: of text in a terminal, of HTML in a notebook."""

    @abstractmethod
    def _laid_out(self) -> Table:
        """Return the table."""

    def __repr__(self) -> str:
        return render(self._laid_out(), "terminal", width=_WIDTH).rstrip("\n")

    def _repr_html_(self) -> str:
        return render(self._laid_out(), "html")


@dataclass(frozen=True, eq=False, repr=False)
class Result(Tabular, Scored):
    """A method's result with its records.

    Attributes
    ----------
    name : str
        The method's.
    result : airzoo_bench.results.result.Result
        The content of result.json: protocol, truth, predictions, counts, notes, scores.
    records : DataFrame
        A row a query, or a scene in reconstruction, sorted by ``query``.
    """

    @property
    def overall(self) -> dict[str, float]:
        """Every score's unweighted mean over scenes; shares are 0 to 1."""
        return dict(self.result.overall)

    def to_frame(self) -> pd.DataFrame:
        """Return scenes x scores, with the rows ``overall`` and ``pooled`` last.

        Returns
        -------
        DataFrame
            By the id of the scene and the key of the score; shares are 0 to 1.
        """
        import pandas as pd

        result = self.result
        rows = {**result.scenes, "overall": result.overall, "pooled": result.pooled}
        frame = pd.DataFrame.from_dict(rows, orient="index")
        return frame[[column.key for column in result.columns]].rename_axis("scene")

    def _laid_out(self) -> Table:
        return scenes_table(self.result, floors=True)


def load_result(path: str | Path, *, name: str | None = None) -> Result:
    """Read a result that ``airzoo-bench eval ... --out DIR`` wrote, and its records.

    Parameters
    ----------
    path : path
        Of ``result.json``, or of the folder that holds it.
    name : str, optional
        What to call the method, instead of its own name.

    Returns
    -------
    Result
        It shows itself as the table that ``eval`` prints; see `Result.to_frame` and `records`.

    Raises
    ------
    UserError
        It is missing, was changed since it was written, or its records do not fit it.

    Examples
    --------
    >>> load_result("nowhere")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    airzoo_bench.core.errors.ResultError: ...
    """
    (found,) = read_scored(results_here([path if is_url(path) else path_of("path", path)]))
    return Result(found.name if name is None else name, found.result, found.records)
