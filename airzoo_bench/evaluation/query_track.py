"""A track whose predictions have a row a query, of all scenes in one file."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from typing import Protocol as Structural

from airzoo_bench.core.errors import PredictionError, ProtocolError, UsageError, first_of
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.parts import Resources, ScoredScene, Truth
from airzoo_bench.evaluation.track import Track

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

    from airzoo_bench.core.ids import Assignment
    from airzoo_bench.evaluation.prediction_files import QueryPredictions
    from airzoo_bench.protocol.model import Protocol

__all__ = ["HasQueries", "QueryTrack"]


class HasQueries(Truth, Structural):
    """The truth of a scene of queries."""

    @property
    def queries(self) -> pd.DataFrame:
        """A row a query, with its ``id``."""


P = TypeVar("P", bound="Protocol")
Q = TypeVar("Q", bound="QueryPredictions[Any]")
H = TypeVar("H", bound=HasQueries)
C = TypeVar("C")
S = TypeVar("S", bound=ScoredScene)


class QueryTrack(Track[P, Q, H, "Assignment", C, S]):
    """A track whose predictions have a row a query."""

    @abstractmethod
    def match_scene(
        self,
        predictions: Q,
        truth: H,
        rows: NDArray[np.intp],
        protocol: P,
        resources: Resources,
    ) -> C:
        """Return the predictions for the queries of one scene, in their order.

        Parameters
        ----------
        predictions : QueryPredictions
        truth : HasQueries
        rows : (Q,) int
            The row of the predictions for each query, -1 where there is none.
        protocol : Protocol
        resources : Resources

        Raises
        ------
        PredictionError
            They do not fit the scene.
        """

    def assign(self, predictions: Q, protocol: P, truths: Sequence[H], data: Path) -> Assignment:
        """See `Track.assign`."""
        import numpy as np

        from airzoo_bench.core.ids import assign_queries, scene_of

        ids = predictions.query_ids
        assigned = assign_queries(ids, [truth.queries["id"] for truth in truths])
        if truths:
            known = any((found >= 0).any() for found in assigned.rows)
        else:
            known = bool({scene.id for scene in protocol.scenes} & set(np.unique(scene_of(ids))))
        if not known:
            example = str(truths[0].queries["id"].iloc[0]) if truths else None
            raise _other_benchmark(predictions.path, ids, protocol, data, example)
        return assigned

    def match(
        self,
        predictions: Q,
        assigned: Assignment,
        truths: Sequence[H],
        protocol: P,
        resources: Resources,
    ) -> Iterator[C | PredictionError]:
        """See `Track.match`."""
        pairs = zip(truths, assigned.rows, strict=True)
        for truth, rows in resources.progress(pairs, "scenes", len(truths)):
            try:
                yield self.match_scene(predictions, truth, rows, protocol, resources)
            except PredictionError as error:
                yield error

    def expected_counts(self, truth: H) -> dict[str, int]:
        """See `Track.expected_counts`."""
        return {"queries": len(truth.queries)}

    def check_template_path(self, out: Path, *, force: bool) -> None:
        """See `Track.check_template_path`."""
        from airzoo_bench.evaluation.prediction_files import check_npz

        check_npz(out)
        if out.exists() and not out.is_dir() and not force:
            raise UsageError(
                "is there already, and could be a prediction",
                where=out,
                fix="name another file with --out, or add --force",
            )

    def template(
        self, protocol: P, truths: Sequence[H], kind: str, seed: int
    ) -> dict[str, NDArray[Any]]:
        """Return the arrays of an example prediction, at random, without its protocol."""
        raise self.no_template()

    def write_template(
        self, out: Path, protocol: P, truths: Sequence[H], kind: str, seed: int
    ) -> None:
        """See `Track.write_template`."""
        from airzoo_bench.evaluation.prediction_files import write_predictions

        write_predictions(out, protocol.name, self.template(protocol, truths, kind, seed))


def _other_benchmark(
    path: Path,
    ids: NDArray[np.str_],
    protocol: Protocol,
    data: Path,
    example: str | None = None,
) -> PredictionError:
    """Return the error for predictions none of whose ids belongs to the benchmark."""
    import numpy as np

    from airzoo_bench.core.ids import scene_of, with_endings

    scenes = {str(scene) for scene in np.unique(scene_of(ids))}
    ending = scenes <= {scene.id for scene in protocol.scenes} and with_endings(ids)
    alike = [] if ending else _alike(scenes, protocol, data)
    guess = f"they look like those of {' or '.join(alike)}" if alike else ""
    expected = example or ", ".join(f"{scene.id}/..." for scene in protocol.scenes[:3])
    return PredictionError(
        f"none of its query ids belongs to {protocol.benchmark}: {first_of(ids, len(ids))}"
        + (f"; {guess}" if guess else ""),
        where=f"{path}, field 'query_ids'",
        expected=f"ids such as {expected}",
        fix="leave out the file's ending: ids are names without it"
        if ending
        else _scenes_as_titles(scenes, protocol)
        or "name the right protocol with --protocol; `airzoo-bench template` writes the ids"
        + _read_by_names(path, protocol.track),
    )


def _read_by_names(path: Path, track: str) -> str:
    """Name the readers that may take a file too, and know images by paths."""
    known = {name: READERS.get(name) for name in READERS.names()}
    fitting = [name for name, one in known.items() if one.track == track and one.recognise(path)]
    return "".join(f"; or, if these are paths of photos, --reader {name}" for name in fitting)


def _scenes_as_titles(scenes: set[str], protocol: Protocol) -> str:
    """Say how scenes are written that ids call by their title, or in other letters."""
    own = {name.lower(): one.id for one in protocol.scenes for name in (one.title, one.id)}
    meant = [f"{own[name.lower()]} for {name}" for name in sorted(scenes) if name.lower() in own]
    titled = [] if scenes & set(own.values()) else meant[:3]
    return f"write the scene as the protocol does: {', '.join(titled)}" if titled else ""


def _alike(scenes: set[str], protocol: Protocol, data: Path) -> list[str]:
    """Name the protocols of the same track and another benchmark that have one of the scenes."""
    from airzoo_bench.protocol.lookup import protocol_files

    return [
        name
        for name, path in protocol_files(data).items()
        if scenes & _scenes_of_other(path, protocol)
    ]


def _scenes_of_other(path: Path, protocol: Protocol) -> set[str]:
    """Return the scenes of a protocol file, unless it is of another track or this benchmark."""
    from airzoo_bench.protocol.lookup import load_protocol

    try:
        other = load_protocol(path)
    except ProtocolError:  # another benchmark's error is not this file's
        return set()
    if other.track != protocol.track or other.benchmark == protocol.benchmark:
        return set()
    return {scene.id for scene in other.scenes}
