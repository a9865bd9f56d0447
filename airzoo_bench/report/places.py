"""Positions of queries and their photos, which the benchmark folder adds to a section."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark, needed
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import fingerprint
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import LONLAT_CRS
from airzoo_bench.geometry.rasters import RasterInfo, open_info, to_map_pixels
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.report.sections import Section
from airzoo_bench.retrieval.truth import (
    ANCHOR_COLUMNS,
    BOX_COLUMNS,
    Positives,
    RetrievalTruth,
    scene_truth,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Place", "find_places"]


@dataclass(frozen=True, eq=False)
class Place:
    """A scene and its map, with Q queries and T tiles.

    Attributes
    ----------
    dom : RasterInfo or None
        The map; None where the gallery is a set of images.
    gallery : Path
        The map that tiles are cut from, or the folder of the images.
    outlines : (Q, 4, 2) array
        Of the footprints in pixels of the map, NaN where a query has none.
    centres : (Q, 2) array
        Where the query is, in pixels of the map; NaN where that is not known.
    tiles : DataFrame
        With the windows in pixels of the gallery's map, or the files of the images.
    tile_outlines : (T, 4, 2) array
    positives : Positives
        Which tiles answer which query; of the retrieval track.
    crops : dict of str to (x, y, width, height)
        Where a query is on the map, in pixels of it; of the matching track.
    """

    scene: str
    dom: RasterInfo | None
    gallery: Path
    photos: dict[str, Path]
    queries: list[str]
    outlines: Floats
    centres: Floats
    tiles: pd.DataFrame | None = None
    tile_outlines: Floats = field(default_factory=lambda: np.zeros((0, 4, 2)))
    positives: Positives | None = None
    crops: dict[str, tuple[int, ...]] = field(default_factory=dict)


def find_places(section: Section, data: Path) -> list[Place]:
    """Read where the queries of a section are."""
    readers: dict[str, Callable[[Section, Benchmark], list[Place]]] = {
        "retrieval": _retrieval_places,
        "matching": _matching_places,
    }
    reader = readers.get(section.track)
    if reader is None:
        return []
    benchmark = find_benchmark(section.first.truth.benchmark, data)
    with benchmark.fixes():
        return reader(section, benchmark)


def _check_truth(section: Section, benchmark: Benchmark, prints: dict[str, str]) -> None:
    if fingerprint(prints) != section.first.truth.fingerprint:
        raise BenchmarkError(
            "its truth is not the one that the results were made with",
            where=benchmark.folder,
            expected=f"fingerprint {section.first.truth.fingerprint[:12]}",
            fix="name the right benchmark folder with --data, or score again",
        )


def _retrieval_places(section: Section, benchmark: Benchmark) -> list[Place]:
    truths = [scene_truth(benchmark, s) for s in section.first.scenes]
    _check_truth(section, benchmark, {truth.scene: truth.fingerprint for truth in truths})
    return [
        _place_of_images(truth, benchmark)
        if truth.of_images
        else _retrieval_place(truth, benchmark)
        for truth in truths
    ]


def _place_of_images(truth: RetrievalTruth, benchmark: Benchmark) -> Place:
    entry, n = benchmark.scene(truth.scene), len(truth.queries)
    return Place(
        truth.scene,
        None,
        benchmark.resolve(needed(entry.gallery, "gallery", truth.scene)),
        _photos(truth.queries, benchmark.resolve(entry.images)),
        truth.queries["id"].tolist(),
        np.full((n, 4, 2), np.nan),
        np.full((n, 2), np.nan),
        truth.tiles,
        positives=truth.positives,
    )


def _retrieval_place(truth: RetrievalTruth, benchmark: Benchmark) -> Place:
    entry = benchmark.scene(truth.scene)
    dom = open_info(benchmark.resolve(needed(entry.dom, "map", truth.scene)))
    anchors = [name for name in ANCHOR_COLUMNS if name in truth.footprints.columns]
    corners = (
        truth.footprints[anchors].to_numpy(np.float64).reshape(-1, 4, 2)
        if len(anchors) == len(ANCHOR_COLUMNS)
        else np.full((len(truth.queries), 4, 2), np.nan)
    )
    boxes = truth.tiles[list(BOX_COLUMNS)].to_numpy(np.float64)
    return Place(
        truth.scene,
        dom,
        benchmark.resolve(entry.gallery) if entry.gallery else dom.path,
        _photos(truth.queries, benchmark.resolve(entry.images)),
        truth.queries["id"].tolist(),
        _on_map(dom, corners),
        _on_map(dom, truth.footprint_centres),
        truth.tiles,
        _on_map(dom, boxes[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]),
        truth.positives,
    )


def _matching_places(section: Section, benchmark: Benchmark) -> list[Place]:
    truths = [read_matching(benchmark, scene) for scene in section.first.scenes]
    _check_truth(section, benchmark, {truth.scene: truth.fingerprint for truth in truths})
    return [_matching_place(truth, benchmark) for truth in truths]


def _matching_place(truth: MatchingTruth, benchmark: Benchmark) -> Place:
    entry = benchmark.scene(truth.scene)
    ids = truth.queries["id"].tolist()
    photos = _photos(truth.queries, benchmark.resolve(entry.images))
    if truth.scene_map is None:  # there is no map that all queries are on
        nowhere = np.full((len(ids), 4, 2), np.nan)
        return Place(truth.scene, None, truth.maps[0].dom.path, photos, ids, nowhere, nowhere[:, 0])
    dom, flat = truth.scene_map.dom, truth.poses.centres[:, :2]
    centres = to_map_pixels(entry.crs, dom)(flat)
    return Place(
        truth.scene,
        dom,
        dom.path,
        photos,
        ids,
        _footprints(truth, dom, benchmark),
        centres,
        crops={name: tuple(window) for name, window in zip(ids, truth.crops.tolist(), strict=True)},
    )


def _footprints(truth: MatchingTruth, dom: RasterInfo, benchmark: Benchmark) -> Floats:
    """Return footprints from the retrieval truth in the same folder, NaN where there are none."""
    outlines = np.full((len(truth.queries), 4, 2), np.nan)
    path = benchmark.scene_folder(truth.scene) / "retrieval" / "footprints.csv"
    if not path.is_file():
        return outlines
    table = read_table(path, ("id",)).set_index("id")
    anchors = table[[name for name in ANCHOR_COLUMNS if name in table]]
    if anchors.empty:  # made by another rule, without anchors: there are no outlines
        return outlines
    numbers = all(kind.kind in "iuf" for kind in anchors.dtypes)
    if anchors.shape[1] < len(ANCHOR_COLUMNS) or anchors.index.has_duplicates or not numbers:
        raise BenchmarkError(
            "it has not four corners, as numbers, of each footprint once",
            where=path,
            expected="id, " + ", ".join(ANCHOR_COLUMNS),
            fix="prepare the benchmark again",
        )
    corners = anchors.reindex(truth.queries["id"]).to_numpy(np.float64)
    return _on_map(dom, corners.reshape(-1, 4, 2))


def _photos(queries: pd.DataFrame, folder: Path) -> dict[str, Path]:
    return {i: folder / str(n) for i, n in zip(queries["id"], queries["image"], strict=True)}


def _on_map(dom: RasterInfo, lonlat: Floats) -> Floats:
    """Take degrees (..., 2) to pixels of the map; NaN stays."""
    flat = lonlat.reshape(-1, 2)
    known = np.isfinite(flat).all(axis=1)
    pixels = np.full(flat.shape, np.nan)
    pixels[known] = to_map_pixels(LONLAT_CRS, dom)(flat[known])
    return pixels.reshape(lonlat.shape)
