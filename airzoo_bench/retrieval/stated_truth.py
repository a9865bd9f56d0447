"""The truth of a benchmark that gives images and says itself which belong together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.pairs import Positives, offsets_of
from airzoo_bench.retrieval.prepare import PreparedScene
from airzoo_bench.retrieval.settings import StatedTruth
from airzoo_bench.retrieval.truth import POSITION_COLUMNS, RetrievalTruth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ImageSet", "StatedPairs", "build_truth", "pairs_of_labels"]

NO_CLASS = "no image of its class is in the gallery"
NO_PAIR = "the benchmark states no image that answers it"


@dataclass(frozen=True, eq=False)
class ImageSet:
    """The queries or the gallery of a scene.

    Attributes
    ----------
    names : sequence of N str
        What ids have after the scene.
    images : sequence of N str
        Files, relative to the folder of the set.
    positions : (N, 2) array, optional
        Longitude and latitude, or metres.
    degrees : bool
        Which of these they are.
    conditions : mapping of str to sequence of N
        Columns by which scores of queries can be broken down.
    """

    names: Sequence[str]
    images: Sequence[str]
    positions: Floats | None = None
    degrees: bool = False
    conditions: Mapping[str, Sequence[Any]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class StatedPairs:
    """Which query (by its row) goes with which image of the gallery.

    Attributes
    ----------
    queries, tiles : (P,) int
        Each pair once.
    positive : (P,) bool
        Which pairs are answers; the others are known to the benchmark, and none.
    weight : (P,) float, optional
        Overlap that the benchmark states, 0 to 1.
    """

    queries: Ints
    tiles: Ints
    positive: Bools
    weight: Floats | None = None


def pairs_of_labels(queries: Sequence[str], gallery: Sequence[str]) -> StatedPairs:
    """Pair each query with all images of its class."""
    classes, codes = np.unique(np.array([*queries, *gallery], dtype=str), return_inverse=True)
    asked, given = codes[: len(queries)], codes[len(queries) :]
    order = np.argsort(given, kind="stable")
    starts = np.searchsorted(given[order], np.arange(len(classes) + 1))
    counts = np.diff(starts)[asked]
    offsets = offsets_of(counts)
    within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], counts)
    tiles = order[np.repeat(starts[asked], counts) + within]
    rows = np.repeat(np.arange(len(queries)), counts)
    return StatedPairs(rows, tiles.astype(np.int64), np.ones(len(tiles), np.bool_))


def build_truth(
    scene: str, queries: ImageSet, gallery: ImageSet, pairs: StatedPairs, rules: StatedTruth
) -> PreparedScene:
    """Lay out queries, gallery and pairs as the truth of a scene."""
    asked, asked_order = _table(scene, queries, "queries")
    tiles, tile_order = _table(scene, gallery, "images of the gallery")
    stated = _sparse(pairs, asked_order, tile_order)
    positives = _sparse(_only(pairs, pairs.positive), asked_order, tile_order)
    answerable = positives.counts > 0
    kept = answerable if rules.without_positive == "exclude" else np.ones_like(answerable)
    if not kept.any():
        raise BenchmarkError(
            f"scene {scene} has no query that an image of its gallery answers",
            fix="look whether queries and gallery are of one benchmark",
        )
    rows = np.flatnonzero(kept)
    reason = NO_CLASS if rules.rule == "labels" else NO_PAIR
    truth = RetrievalTruth(
        scene,
        asked[["id", "image", *queries.conditions]].iloc[rows].reset_index(drop=True),
        asked.drop(columns=["image", *queries.conditions]).iloc[rows].reset_index(drop=True),
        tiles.drop(columns=list(gallery.conditions)),
        positives.take(rows),
        asked[["id", "image"]].assign(reason=reason)[~kept].reset_index(drop=True),
        tiles[["id", "image"]].iloc[:0],
    )
    return PreparedScene(truth, stated.take(rows), in_map_frame=False)


def _table(scene: str, images: ImageSet, what: str) -> tuple[pd.DataFrame, Ints]:
    """Lay out a set sorted by id; also give the new row of each image."""
    import pandas as pd

    ids = [f"{scene}/{name}" for name in images.names]
    table = pd.DataFrame({"id": ids, "image": list(images.images)})
    twice = table[table["id"].duplicated(keep=False)].sort_values("id", kind="stable")
    if len(twice):
        raise BenchmarkError(
            f"{what} of scene {scene} of which several have one name: "
            f"{first_of(twice['image'], len(table))}",
            expected="each name once, without its ending",
            fix="remove the copies",
        )
    if images.positions is not None:
        degrees, metres = POSITION_COLUMNS
        columns = degrees if images.degrees else metres
        table = table.assign(**dict(zip(columns, images.positions.T, strict=True)))
    table = table.assign(**{name: list(values) for name, values in images.conditions.items()})
    order = np.argsort(table["id"].to_numpy(str), kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return table.iloc[order].reset_index(drop=True), place


def _only(pairs: StatedPairs, some: Bools) -> StatedPairs:
    weight = None if pairs.weight is None else pairs.weight[some]
    return StatedPairs(pairs.queries[some], pairs.tiles[some], pairs.positive[some], weight)


def _sparse(pairs: StatedPairs, queries: Ints, tiles: Ints) -> Positives:
    """Return pairs by the new rows (Q,) of queries and (G,) of images."""
    query, tile = queries[pairs.queries], tiles[pairs.tiles]
    order = np.lexsort((tile, query))
    weight = None if pairs.weight is None else pairs.weight[order]
    offsets = offsets_of(np.bincount(query, minlength=len(queries)))
    return Positives(offsets, tile[order].astype(np.int32), weight)
