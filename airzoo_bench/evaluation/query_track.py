"""A track whose predictions have a row a query, of all scenes in one file."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.ids import Assignment, assign_queries, scene_of
from airzoo_bench.evaluation.parts import HasQueries, QueryPredictions, ScoredScene
from airzoo_bench.evaluation.resources import Resources
from airzoo_bench.evaluation.track import Track
from airzoo_bench.protocol.choice import other_benchmark
from airzoo_bench.protocol.model import Protocol

__all__ = ["QueryTrack"]

P = TypeVar("P", bound=Protocol)
Q = TypeVar("Q", bound=QueryPredictions)
H = TypeVar("H", bound=HasQueries)
C = TypeVar("C")
S = TypeVar("S", bound=ScoredScene)


class QueryTrack(Track[P, Q, H, Assignment, C, S]):
    """A track whose predictions have a row a query."""

    @abstractmethod
    def claim(
        self,
        predictions: Q,
        truth: H,
        rows: NDArray[np.intp],
        protocol: P,
        resources: Resources,
    ) -> C:
        """Hold predictions against one scene.

        Parameters
        ----------
        predictions, truth, protocol, resources
            See `Track`.
        rows : (Q,) int
            The row that answers each query, -1 where there is none.

        Raises
        ------
        PredictionError
            They do not fit the scene.
        """

    def assign(self, predictions: Q, protocol: P, truths: Sequence[H], data: Path) -> Assignment:
        """See `Track.assign`."""
        ids = predictions.query_ids
        assigned = assign_queries(ids, [truth.queries["id"] for truth in truths])
        if truths:
            known = any((found >= 0).any() for found in assigned.rows)
        else:
            known = bool({scene.id for scene in protocol.scenes} & set(np.unique(scene_of(ids))))
        if not known:
            example = str(truths[0].queries["id"].iloc[0]) if truths else None
            raise other_benchmark(predictions.path, ids, protocol, data, example)
        return assigned

    def claims(
        self,
        predictions: Q,
        assigned: Assignment,
        truths: Sequence[H],
        protocol: P,
        resources: Resources,
    ) -> Iterator[C | PredictionError]:
        """See `Track.claims`."""
        pairs = zip(truths, assigned.rows, strict=True)
        for truth, rows in resources.progress(pairs, "scenes", len(truths)):
            try:
                yield self.claim(predictions, truth, rows, protocol, resources)
            except PredictionError as error:
                yield error

    def expected_counts(self, truth: H) -> dict[str, int]:
        """See `Track.expected_counts`."""
        return {"queries": len(truth.queries)}

    def kind(self, predictions: Q, scored: Sequence[S]) -> str:
        """See `Track.kind`."""
        return predictions.kind

    def template(
        self, protocol: P, truths: Sequence[H], kind: str, seed: int
    ) -> dict[str, NDArray[Any]]:
        """Return the arrays of an example prediction, at random, without its protocol."""
        raise NotImplementedError(f"the {self.name} track has no template")

    def write_template(
        self, out: Path, protocol: P, truths: Sequence[H], kind: str, seed: int
    ) -> None:
        """See `Track.write_template`."""
        arrays = self.template(protocol, truths, kind, seed)
        with atomic_write(out) as stream:
            write_npz(stream, {"protocol": np.array(protocol.name), **arrays})
