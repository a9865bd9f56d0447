"""What readers of the retrieval track share: names, descriptors of several files, metrics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.readers.names import ImageNames, names_in, scene_finder

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from airzoo_bench.evaluation.reader import Reading
    from airzoo_bench.formats.budget import Budget
    from airzoo_bench.retrieval.predictions import RetrievalPredictions
    from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = [
    "NamedRows",
    "SceneImages",
    "aside",
    "check_descriptors",
    "gallery_rows",
    "join",
    "query_rows",
    "ranked_lists",
    "tile_images",
]

_LONGEST_NAME = 80
_COPIES_OF_TEXT = 5  # the ids, and what a run makes while it splits, sorts and compares them


@dataclass(frozen=True, eq=False)
class SceneImages:
    """The photos and tiles of some scenes by name.

    Attributes
    ----------
    truths : tuple of RetrievalTruth
        Names are taken from them, and nothing else.
    scenes : tuple of str
        Ids of further scenes that paths may name, see `Reading`.
    home : str
        A path whose scene is meant by names without one, or a scene.
    """

    truths: tuple[RetrievalTruth, ...]
    scenes: tuple[str, ...] = ()
    home: str = ""

    @classmethod
    def of(cls, reading: Reading, path: Path) -> SceneImages:
        """Take the names of scenes."""
        if not reading.truths:
            raise PredictionError(
                "its names of images mean nothing without the benchmark, whose folder is missing",
                where=path,
                expected="a prepared benchmark",
                fix="say where it is with --data, or prepare it",
            )
        return cls(tuple(reading.truths), reading.scenes, str(path))

    @cached_property
    def queries(self) -> ImageNames:
        """The photos that are queries."""
        return ImageNames.of(
            "query",
            names_in(one.queries for one in self.truths),
            left_out=names_in(one.excluded for one in self.truths),
            scenes=self.scenes,
            home=self.home,
        )

    @cached_property
    def tiles(self) -> ImageNames:
        """The galleries."""
        tiles = chain.from_iterable(map(tile_images, self.truths))
        return ImageNames.of("tile", tiles, scenes=self.scenes, home=self.home)

    def of_run(self, folders: Iterable[str]) -> SceneImages:
        """Take the scene that the folders of a run name for that of its names without one."""
        scene_of = scene_finder(truth.scene for truth in self.truths)
        named = {scene_of(folder) for folder in folders} - {None}
        return replace(self, home="".join(map(str, named)) if len(named) == 1 else "")


def tile_images(truth: RetrievalTruth) -> Iterator[tuple[str, str]]:
    """Yield ids of tiles with the names of their files, as `prepare --tiles files` writes them."""
    if truth.of_images:
        return names_in([truth.tiles])
    return ((one, f"{one.split('/', 1)[1]}.png") for one in truth.tiles["id"].tolist())


@dataclass(frozen=True, eq=False)
class NamedRows:
    """Descriptors (N, D) with N ids; `strange` are names that are those of no image asked for."""

    ids: NDArray[np.str_]
    rows: NDArray[np.floating[Any]]
    strange: int = 0


def check_descriptors(path: Path, what: str, rows: NDArray[Any], names: int | None = None) -> None:
    """Refuse what are no descriptors, or not as many as there are names."""
    fine = rows.ndim == 2 and rows.dtype.kind in "biuf" and rows.dtype.itemsize <= 8
    if not fine or not rows.size:
        raise PredictionError(
            f"{what} has type {rows.dtype} and shape {rows.shape}",
            where=path,
            expected="descriptors: numbers of at most 64 bits, a row an image",
            fix="write the file again",
        )
    if names is not None and names != len(rows):
        raise PredictionError(
            f"{what} has {counted(len(rows), 'row')}, and there are {counted(names, 'name')}",
            where=path,
            expected="a name for each row",
            fix="run the method again, or give its image names, in its order, with --names",
        )


def query_rows(
    names: Sequence[str], rows: NDArray[Any], images: SceneImages, where: Path
) -> NamedRows:
    """Keep the rows of queries; other photos may be described too, and are counted."""
    import numpy as np

    found = images.queries.find_all(names, where)
    kept = [row for row, one in enumerate(found) if one is not None]
    ids = np.array([found[row] for row in kept], dtype=str)
    return NamedRows(ids, rows if len(kept) == len(rows) else rows[kept], len(rows) - len(kept))


def aside(strange: int) -> tuple[str, ...]:
    """Say how many described photos are no queries, if any."""
    return (f"{counted(strange, 'photo')} described that are no queries, left aside",) * (
        strange > 0
    )


def gallery_rows(
    names: Sequence[str], rows: NDArray[Any], images: SceneImages, where: Path
) -> NamedRows:
    """Name the rows of a gallery, which may be mapped; what is no tile keeps its own name."""
    import numpy as np

    found = images.tiles.find_all(names, where)
    ids = [
        one if one is not None else f"row {row}/{_shown(name)}"
        for row, (one, name) in enumerate(zip(found, names, strict=True))
    ]
    return NamedRows(np.array(ids, dtype=str), rows)


def _shown(name: str) -> str:
    shown = "".join(letter if letter.isprintable() else "?" for letter in name[-_LONGEST_NAME:])
    return shown.rstrip("/") or "unnamed"


def join(
    path: Path, queries: Sequence[NamedRows], galleries: Sequence[NamedRows]
) -> RetrievalPredictions:
    """Make predictions of descriptors; the galleries of several files stay where they are."""
    import numpy as np

    from airzoo_bench.evaluation.queries import QueryPredictions
    from airzoo_bench.formats.arrays import as_floating
    from airzoo_bench.retrieval.descriptors import Rows
    from airzoo_bench.retrieval.predictions import Descriptors

    lengths = sorted({one.rows.shape[1] for one in (*queries, *galleries)})
    if len(lengths) > 1:
        raise PredictionError(
            f"descriptors of {' and '.join(map(str, lengths))} dimensions",
            where=path,
            expected="one number of dimensions in all files",
            fix="describe photos and tiles of all scenes with one model",
        )
    asked = np.concatenate([one.ids for one in queries])
    parts = [as_floating(one.rows) for one in queries]
    rows = parts[0] if len(parts) == 1 else np.concatenate(parts)
    tiles = np.concatenate([one.ids for one in galleries])
    gallery = Rows.join(*(one.rows for one in galleries))
    return QueryPredictions(path, None, asked, Descriptors(rows, tiles, gallery))


def ranked_lists(
    path: Path,
    lists: Mapping[str, Sequence[str]],
    scores: Mapping[str, Sequence[float]] | None,
    budget: Budget,
) -> RetrievalPredictions:
    """Make predictions of ranked ids, best first, of any lengths."""
    import numpy as np

    from airzoo_bench.evaluation.queries import QueryPredictions
    from airzoo_bench.retrieval.predictions import RankedIds

    if not lists:
        raise PredictionError("ranks no tile", where=path, expected="a list for each query")
    depth = max(map(len, lists.values()))
    letters = max((len(one) for ids in lists.values() for one in set(ids)), default=1)
    size = len(lists) * depth * (4 * letters * _COPIES_OF_TEXT + 8)
    budget.hold(path, f"lists of {depth:,} tiles", size, "rank fewer tiles for each query")
    ids = np.full((len(lists), depth), "", f"<U{letters}")
    given = None if scores is None else np.zeros(ids.shape)
    for row, query in enumerate(lists):
        ids[row, : len(lists[query])] = lists[query]
        if given is not None and scores is not None:
            given[row, : len(lists[query])] = scores[query]
    return QueryPredictions(path, None, np.array(list(lists), dtype=str), RankedIds(ids, given))
