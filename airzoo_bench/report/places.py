"""Where queries and photos of a section are, which the benchmark folder adds to its results."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark, needed
from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.core.files import fingerprint
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import LONLAT_CRS
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, open_info, read_rgb, to_map_pixels
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.report.figures import Sheet, new_canvas
from airzoo_bench.report.sections import Section
from airzoo_bench.retrieval.truth import ANCHOR_COLUMNS, scene_truth

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Window = tuple[int, int, int, int]
_LONG_SIDE_PX = 1000


@dataclass(frozen=True, eq=False)
class Place:
    """A scene with its truth, photos and map, of Q queries as in the records; pixels are the map's.

    Footprints and tiles are outlines of four corners, NaN where they are not known.
    """

    scene: str
    truth: Any  # of the track
    photos: dict[str, Path]  # by the ids of the queries
    dom: RasterInfo | None = None  # the map of the whole scene
    gallery: Path | None = None  # the map of the tiles, or the folder of the images
    outlines: Floats = field(default_factory=lambda: np.zeros((0, 4, 2)))  # (Q, 4, 2)
    centres: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # (Q, 2)
    tiles: Floats = field(default_factory=lambda: np.zeros((0, 4, 2)))  # (T, 4, 2)
    to_map: Callable[[Floats], Floats] | None = None  # from the scene's CRS to pixels

    def row_of(self, query: str) -> int:
        """Return the row of a query in the arrays of this place."""
        return list(self.photos).index(query)


def find_places(section: Section, data: Path) -> list[Place]:
    """Find the benchmark folder of a section, and read where its queries are."""
    return places_of(section, find_benchmark(section.first.truth.benchmark, data))


def places_of(section: Section, benchmark: Benchmark) -> list[Place]:
    """Read where the queries of a section are; empty for tracks that are not known here."""
    readers = {"retrieval": _retrieval, "matching": _matching, "reconstruction": _reconstruction}
    if section.track not in readers:
        return []
    with benchmark.fixes():
        found = [readers[section.track](benchmark, scene) for scene in section.first.scenes]
    made_with = section.first.truth.fingerprint
    if fingerprint({place.scene: place.truth.fingerprint for place in found}) != made_with:
        raise BenchmarkError(
            "its truth is not the one that the results were made with",
            where=benchmark.folder,
            expected=f"fingerprint {made_with[:12]}",
            fix="name the right benchmark folder with --data, or score again",
        )
    return found


def _retrieval(benchmark: Benchmark, scene: str) -> Place:
    truth, entry = scene_truth(benchmark, scene), benchmark.scene(scene)
    photos = _photos(truth.queries, benchmark, scene)
    if truth.of_images:
        gallery = benchmark.resolve(needed(entry.gallery, "gallery", scene))
        return Place(scene, truth, photos, gallery=gallery)
    dom = open_info(benchmark.resolve(needed(entry.dom, "map", scene)))
    anchors = truth.footprints.reindex(columns=list(ANCHOR_COLUMNS)).to_numpy(np.float64)
    return Place(
        scene,
        truth,
        photos,
        dom,
        benchmark.resolve(entry.gallery) if entry.gallery else dom.path,
        _on_map(dom, anchors.reshape(-1, 4, 2)),
        _on_map(dom, truth.footprint_centres),
        _on_map(dom, truth.boxes[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]),
    )


def _matching(benchmark: Benchmark, scene: str) -> Place:
    truth = read_matching(benchmark, scene)
    photos = _photos(truth.queries, benchmark, scene)
    if truth.map_per_query:  # there is no map that all queries are on
        return Place(scene, truth, photos)
    dom = truth.maps[0].dom
    to_map = to_map_pixels(benchmark.scene(scene).crs, dom)
    centres = to_map(truth.poses.centres[:, :2])
    unknown = np.full((len(centres), 4, 2), np.nan)
    return Place(scene, truth, photos, dom, outlines=unknown, centres=centres, to_map=to_map)


def _reconstruction(benchmark: Benchmark, scene: str) -> Place:
    truth = read_reconstruction(benchmark, scene)
    return Place(scene, truth, _photos(truth.photos, benchmark, scene))


def _photos(queries: pd.DataFrame, benchmark: Benchmark, scene: str) -> dict[str, Path]:
    folder = benchmark.resolve(benchmark.scene(scene).images)
    return {i: folder / str(n) for i, n in zip(queries["id"], queries["image"], strict=True)}


def _on_map(dom: RasterInfo, lonlat: Floats) -> Floats:
    """Take degrees (..., 2) to pixels of the map; NaN stays."""
    flat = lonlat.reshape(-1, 2)
    known = np.isfinite(flat).all(axis=1)
    pixels = np.full(flat.shape, np.nan)
    pixels[known] = to_map_pixels(LONLAT_CRS, dom)(flat[known])
    return pixels.reshape(lonlat.shape)


def true_window(place: Place, query: str) -> tuple[RasterInfo, Window] | None:
    """Return the map and the part of it that a query shows; None where that is not known."""
    row = place.row_of(query)
    if hasattr(place.truth, "crops"):
        x, y, width, height = place.truth.crops[row].tolist()
        return place.truth.map_of(row).dom, (x, y, width, height)
    if place.dom is None or not np.isfinite(place.outlines[row]).all():
        return None
    corners = np.clip(place.outlines[row], 0, (place.dom.width, place.dom.height))
    low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0))
    x, y, width, height = np.concatenate([low, high - low]).astype(int).tolist()
    return (place.dom, (x, y, width, height)) if width and height else None


def jpeg(pixels: NDArray[np.uint8], quality: int = 70) -> bytes:
    """Write a picture (height, width, 3) as JPEG."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=quality, optimize=True)
    return stream.getvalue()


def draw_ground(place: Place, sheet: Sheet) -> tuple[Figure, Axes, float]:
    """Draw the map of a place; return its figure, axes in metres, and metres per pixel."""
    if place.dom is None:
        raise UsageError(f"scene {place.scene} has no map", expected="queries that share a map")
    wide, high, metres = place.dom.width, place.dom.height, gsd_m(place.dom)[0]
    inches = sheet.wide(7.0)
    figure = new_canvas(inches, inches * min(high / wide, 1.5) * 0.9 + 0.6)
    axes = figure.add_subplot()
    extent = (0.0, wide * metres, high * metres, 0.0)
    axes.imshow(read_rgb(place.dom.path, long_side_px=_LONG_SIDE_PX), extent=extent)
    axes.set(xlabel="metres from the left of the map", ylabel="metres from its top")
    axes.set(xlim=extent[:2], ylim=extent[2:], autoscale_on=False)
    return figure, axes, metres
