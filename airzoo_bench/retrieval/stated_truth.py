"""The truth of a benchmark that gives images and says itself which belong together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.prepare import PreparedScene
from airzoo_bench.retrieval.settings import StatedRules
from airzoo_bench.retrieval.truth import (
    POSITION_COLUMNS,
    Positives,
    RetrievalTruth,
    offsets_of,
)


@dataclass(frozen=True, eq=False)
class ImageSet:
    """The queries or the gallery of a scene, N images."""

    names: Sequence[str]  # what ids have after the scene
    images: Sequence[str]  # files, relative to the folder of the set
    positions: Floats | None = None  # (N, 2) longitude and latitude, or metres
    degrees: bool = False  # which of these they are
    conditions: Mapping[str, Sequence[Any]] = field(default_factory=dict)  # columns of queries


@dataclass(frozen=True, eq=False)
class StatedPairs:
    """Pairs of a query (by its row) and an image of the gallery, each once."""

    queries: Ints  # (P,)
    tiles: Ints  # (P,)
    positive: Bools  # (P,) which pairs are answers; the others are known to the benchmark
    weight: Floats | None = None  # (P,) overlap that the benchmark states, 0 to 1


def pairs_of_labels(queries: Sequence[str], gallery: Sequence[str]) -> StatedPairs:
    """Pair each query with all images of its class."""
    asked, given = pd.factorize(np.array([*queries, *gallery], dtype=str))[0], len(queries)
    images = pd.DataFrame({"label": asked[given:], "tile": np.arange(len(gallery))})
    photos = pd.DataFrame({"label": asked[:given], "query": np.arange(given)})
    found = photos.merge(images, on="label", sort=False).sort_values(["query", "tile"])
    query, tile = (found[name].to_numpy(np.int64) for name in ("query", "tile"))
    return StatedPairs(query, tile, np.ones(len(found), np.bool_))


def build_truth(
    scene: str, queries: ImageSet, gallery: ImageSet, pairs: StatedPairs, rules: StatedRules
) -> PreparedScene:
    """Lay out queries, gallery and pairs as the truth of a scene."""
    asked, asked_order = _table(scene, queries, "queries")
    tiles, tile_order = _table(scene, gallery, "images of the gallery")
    query, tile = asked_order[pairs.queries], tile_order[pairs.tiles]
    order = np.lexsort((tile, query))
    stated = Positives(
        offsets_of(np.bincount(query, minlength=len(asked))),
        tile[order].astype(np.int32),
        None if pairs.weight is None else pairs.weight[order],
    )
    positives = stated.where(pairs.positive[order])
    kept = positives.counts > 0
    if rules.without_positive == "miss":
        kept[:] = True
    if not kept.any():
        raise BenchmarkError(
            f"scene {scene} has no query that an image of its gallery answers",
            fix="look whether queries and gallery are of one benchmark",
        )
    rows, conditions = np.flatnonzero(kept), list(queries.conditions)
    reason = "the benchmark states no image that answers it"
    if rules.rule == "labels":
        reason = "no image of its class is in the gallery"
    truth = RetrievalTruth(
        scene,
        asked[["id", "image", *conditions]].iloc[rows].reset_index(drop=True),
        asked.drop(columns=["image", *conditions]).iloc[rows].reset_index(drop=True),
        tiles.drop(columns=list(gallery.conditions)),
        positives.take(rows),
        asked[["id", "image"]].assign(reason=reason)[~kept].reset_index(drop=True),
        tiles[["id", "image"]].iloc[:0],
    )
    return PreparedScene(truth, stated.take(rows), in_map_frame=False)


def _table(scene: str, images: ImageSet, what: str) -> tuple[pd.DataFrame, Ints]:
    """Lay out a set sorted by id; also give the new row of each image."""
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
