"""What goes into a track and comes out of it, as far as all tracks share it."""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from typing import Protocol as Structural

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Assigned",
    "EvalOption",
    "HasQueries",
    "Predictions",
    "QueryPredictions",
    "ScoredScene",
    "Truth",
]


class Predictions(Structural):
    """A prediction file or folder, as read or listed."""

    @property
    def path(self) -> Path:
        """Where it lies."""

    @property
    def protocol(self) -> str | None:
        """The protocol that it names."""


class QueryPredictions(Predictions, Structural):
    """Predictions with a row a query, of all scenes in one file."""

    @property
    def query_ids(self) -> NDArray[np.str_]:
        """Ids ``scene/name`` (Q,)."""

    @property
    def kind(self) -> str:
        """What they hold, for results."""


class Truth(Structural):
    """The truth of a scene."""

    @property
    def scene(self) -> str:
        """Its id."""

    @property
    def fingerprint(self) -> str:
        """SHA-256 over all that scores are held against."""


class HasQueries(Truth, Structural):
    """The truth of a scene of queries."""

    @property
    def queries(self) -> pd.DataFrame:
        """A row a query, with its ``id``."""


class Assigned(Structural):
    """Which part of the predictions answers which query or scene."""

    @property
    def strange(self) -> Sized:
        """What is predicted of queries or scenes that there are not."""

    def notes(self) -> list[str]:
        """Say what is missing or left aside."""


class ScoredScene(Structural):
    """What came of a scene."""

    @property
    def records(self) -> pd.DataFrame:
        """A row a query, pair or cloud."""

    @property
    def counts(self) -> dict[str, int]:
        """What a result states of the scene beside scores: queries, missing ones, failures."""


@dataclass(frozen=True)
class EvalOption:
    """An option of ``airzoo-bench eval`` that one track has.

    Attributes
    ----------
    name : str
        Without its hyphens.
    help : str
    act : str
        Place ``module:function`` of what it does: takes the `evaluation.Evaluation`, the value, the
        folder for output or None, and `Resources`; yields sentences for the person.
    default : bool or int
        A number is asked for from 1 to `most`.
    most : int
    needs_out : bool
        Whether it writes, so that ``--out`` must be given.
    """

    name: str
    help: str
    act: str
    default: bool | int = False
    most: int = 1
    needs_out: bool = True
