"""Where queries and photos of a section are, which the benchmark folder adds to its results."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark, needed
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.core.files import fingerprint
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import LONLAT_CRS
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, open_info, read_rgb, to_map_pixels
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.report.figures import COLOURS, Sheet, finish, label_text, new_canvas
from airzoo_bench.report.sections import Section, tile_columns
from airzoo_bench.retrieval.metrics import hit_matrix
from airzoo_bench.retrieval.truth import ANCHOR_COLUMNS, BOX_COLUMNS, Positives, scene_truth

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Pixels = NDArray[np.uint8]
Window = tuple[int, int, int, int]
_LONG_SIDE_PX, _TILE_PX = 1000, 300


@dataclass(frozen=True, eq=False)
class Place:
    """A scene with its photos and its map, of Q queries and T tiles; pixels are the map's."""

    scene: str
    dom: RasterInfo | None  # the map of the whole scene
    photos: dict[str, Path]  # by the ids of the queries
    outlines: Floats  # (Q, 4, 2), of the footprints; NaN where a query has none
    centres: Floats  # (Q, 2); NaN where the place of a query is not known
    gallery: Path | None = None  # the map of the tiles, or the folder of the images
    tiles: pd.DataFrame | None = None  # windows of the gallery's map, or files of images
    tile_outlines: Floats = field(default_factory=lambda: np.zeros((0, 4, 2)))  # (T, 4, 2)
    positives: Positives | None = None  # of retrieval: the tiles that answer each query
    matching: MatchingTruth | None = None
    to_map: Callable[[Floats], Floats] | None = None  # from the scene's CRS to pixels

    def rows_of(self, queries: Iterable[str]) -> NDArray[np.intp]:
        """Return the rows of queries in the arrays of this place."""
        known = {query: row for row, query in enumerate(self.photos)}
        return np.array([known[query] for query in queries], np.intp)


def find_places(section: Section, data: Path) -> list[Place]:
    """Find the benchmark folder of a section, and read where its queries are."""
    return places_of(section, find_benchmark(section.first.truth.benchmark, data))


def places_of(section: Section, benchmark: Benchmark) -> list[Place]:
    """Read where the queries of a section are; empty for tracks that are not known here."""
    reader = {
        "retrieval": _retrieval_place,
        "matching": _matching_place,
        "reconstruction": _reconstruction_place,
    }.get(section.track)
    if reader is None:
        return []
    with benchmark.fixes():
        found = [reader(benchmark, scene) for scene in section.first.scenes]
    made_with = section.first.truth.fingerprint
    if fingerprint({place.scene: of_truth for place, of_truth in found}) != made_with:
        raise BenchmarkError(
            "its truth is not the one that the results were made with",
            where=benchmark.folder,
            expected=f"fingerprint {made_with[:12]}",
            fix="name the right benchmark folder with --data, or score again",
        )
    return [place for place, _ in found]


def _retrieval_place(benchmark: Benchmark, scene: str) -> tuple[Place, str]:
    truth, entry = scene_truth(benchmark, scene), benchmark.scene(scene)
    photos = _photos(truth.queries, benchmark.resolve(entry.images))
    if truth.of_images:
        gallery = benchmark.resolve(needed(entry.gallery, "gallery", scene))
        place = Place(scene, None, photos, *_nowhere(len(photos)), gallery, truth.tiles)
        return replace(place, positives=truth.positives), truth.fingerprint
    dom = open_info(benchmark.resolve(needed(entry.dom, "map", scene)))
    boxes = truth.tiles[list(BOX_COLUMNS)].to_numpy(np.float64)
    place = Place(
        scene,
        dom,
        photos,
        _on_map(dom, _anchors(truth.footprints)),
        _on_map(dom, truth.footprint_centres),
        benchmark.resolve(entry.gallery) if entry.gallery else dom.path,
        truth.tiles,
        _on_map(dom, boxes[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]),
    )
    return replace(place, positives=truth.positives), truth.fingerprint


def _matching_place(benchmark: Benchmark, scene: str) -> tuple[Place, str]:
    truth, entry = read_matching(benchmark, scene), benchmark.scene(scene)
    photos = _photos(truth.queries, benchmark.resolve(entry.images))
    if truth.own_maps:  # there is no map that all queries are on
        place = Place(scene, None, photos, *_nowhere(len(photos)), matching=truth)
        return place, truth.fingerprint
    dom = truth.maps[0].dom
    to_map = to_map_pixels(entry.crs, dom)
    outlines = _on_map(dom, _footprints(truth, benchmark.scene_folder(scene)))
    centres = to_map(truth.poses.centres[:, :2])
    place = Place(scene, dom, photos, outlines, centres, matching=truth, to_map=to_map)
    return place, truth.fingerprint


def _reconstruction_place(benchmark: Benchmark, scene: str) -> tuple[Place, str]:
    truth = read_reconstruction(benchmark, scene)
    photos = _photos(truth.photos, benchmark.resolve(benchmark.scene(scene).images))
    return Place(scene, None, photos, *_nowhere(len(photos))), truth.fingerprint


def _nowhere(count: int) -> tuple[Floats, Floats]:
    return np.full((count, 4, 2), np.nan), np.full((count, 2), np.nan)


def _photos(queries: pd.DataFrame, folder: Path) -> dict[str, Path]:
    return {i: folder / str(n) for i, n in zip(queries["id"], queries["image"], strict=True)}


def _anchors(footprints: pd.DataFrame) -> Floats:
    """Return corners (Q, 4, 2) of footprints in degrees, NaN where the rule makes none."""
    if not set(ANCHOR_COLUMNS) <= set(footprints.columns):
        return np.full((len(footprints), 4, 2), np.nan)
    return footprints[list(ANCHOR_COLUMNS)].to_numpy(np.float64).reshape(-1, 4, 2)


def _footprints(truth: MatchingTruth, folder: Path) -> Floats:
    """Return footprints from the retrieval truth in the same folder, NaN where there are none."""
    path = folder / "retrieval" / "footprints.csv"
    if not path.is_file():
        return np.full((len(truth.queries), 4, 2), np.nan)
    table = read_table(path, ("id",)).drop_duplicates("id").set_index("id")
    return _anchors(table.reindex(truth.queries["id"]))


def _on_map(dom: RasterInfo, lonlat: Floats) -> Floats:
    """Take degrees (..., 2) to pixels of the map; NaN stays."""
    flat = lonlat.reshape(-1, 2)
    known = np.isfinite(flat).all(axis=1)
    pixels = np.full(flat.shape, np.nan)
    pixels[known] = to_map_pixels(LONLAT_CRS, dom)(flat[known])
    return pixels.reshape(lonlat.shape)


@dataclass(frozen=True, eq=False)
class Retrieved:
    """First tiles of M methods on Q queries of a scene, at D ranks."""

    tiles: NDArray[np.int32]  # (M, Q, D), rows of the scene's tiles; -1 for none
    hits: NDArray[np.bool_]  # (M, Q, D), which of them are positives of the query


def retrieved(section: Section, place: Place, rows: NDArray[np.intp]) -> Retrieved | None:
    """Find the first tiles of queries, which are rows of the records, in the truth of a scene."""
    named = [tile_columns(method.records.columns) for method in section.methods]
    depth = max(map(len, named))
    if place.tiles is None or place.positives is None or not depth:
        return None
    import pandas as pd

    index = pd.Index(place.tiles["id"])
    order = place.rows_of(section.methods[0].records["query"].iloc[rows])
    tiles = np.full((len(section.methods), len(rows), depth), -1, np.int32)
    hits = np.zeros(tiles.shape, np.bool_)
    # In the order of the truth, whose positives are looked up; a query is in it once.
    ranked = np.full((len(place.photos), depth), -1, np.int32)
    for number, (method, columns) in enumerate(zip(section.methods, named, strict=True)):
        for rank, name in enumerate(columns):
            ids = pd.Index(method.records[name].iloc[rows])
            tiles[number, :, rank] = index.get_indexer(ids)
        ranked[order] = tiles[number]
        offsets, positives = place.positives.offsets, place.positives.tiles
        hits[number] = hit_matrix(ranked, offsets, positives, len(index))[order]
    return Retrieved(tiles, hits)


def read_tile(place: Place, tile: int, long_side_px: int) -> Pixels:
    """Read the picture of a tile, which is a row of the place's tiles."""
    assert place.tiles is not None
    assert place.gallery is not None
    row: Any = place.tiles.iloc[tile]
    if "image" in row.index:
        return read_rgb(place.gallery / row["image"], long_side_px=long_side_px)
    x, y, width, height = (int(row[name]) for name in ("x", "y", "width", "height"))
    return read_rgb(place.gallery, (x, y, width, height), long_side_px=long_side_px)


def true_window(place: Place, query: str) -> tuple[RasterInfo, Window] | None:
    """Return the map and the part of it that a query shows; None where that is not known."""
    [row] = place.rows_of([query])
    if place.matching is not None:
        x, y, width, height = place.matching.crops[row].tolist()
        return place.matching.map_of(row).dom, (x, y, width, height)
    outline, dom = place.outlines[row], place.dom
    if dom is None or not np.isfinite(outline).all():
        return None
    size = (dom.width, dom.height)
    low = np.clip(np.floor(outline.min(axis=0)), 0, size).astype(int)
    high = np.clip(np.ceil(outline.max(axis=0)), 0, size).astype(int)
    if not (high > low).all():
        return None
    return dom, (int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1]))


def jpeg(pixels: Pixels, quality: int = 72) -> bytes:
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


@default_style()
def draw_hits(
    section: Section, place: Place, sheet: Sheet | None = None, number: int = 0
) -> Figure:
    """Draw footprints on the map, by whether a method's first tile answers, and misses' tiles."""
    sheet, rows = sheet or Sheet(), section.rows_of(place.scene)
    figure, axes, metres = draw_ground(place, sheet)
    found = retrieved(section, place, rows)
    if found is None:
        raise UsageError("the records name no tiles", fix="score the predictions again")
    order = place.rows_of(section.methods[0].records["query"].iloc[rows])
    first, hits = found.tiles[number, :, 0], found.hits[number, :, 0]
    for tile in np.unique(first[~hits & (first >= 0)]):
        axes.fill(*(place.tile_outlines[tile] * metres).T, fill=False, ec=COLOURS[3], lw=0.8)
    kinds = ((~hits, COLOURS[1], "x", "--", "miss"), (hits, COLOURS[5], "o", "-", "hit"))
    for kind, colour, marker, line, name in kinds:
        for outline in place.outlines[order[kind]]:
            axes.fill(*(outline * metres).T, fill=False, ec=colour, ls=line, lw=1.0)
        label = f"{name} ({int(kind.sum())})"
        style: Any = {"color": colour, "marker": marker, "linestyle": "none", "label": label}
        axes.plot(*(place.centres[order[kind]] * metres).T, **style)
    axes.plot([], [], "s", mfc="none", color=COLOURS[3], label="first tile of a miss")
    axes.legend(loc="best", fontsize=8)
    name = section.methods[number].name
    finish(figure, sheet.noting(f"{name}, scene {place.scene}: footprints, by the first tile"))
    return figure


@default_style()
def draw_tiles(
    section: Section, place: Place, query: str, sheet: Sheet | None = None, number: int = 0
) -> Figure:
    """Draw a query's photo, its true place on the map, and a method's first tiles."""
    sheet = sheet or Sheet()
    records = section.methods[0].records
    found = retrieved(section, place, np.flatnonzero(records["query"] == query))
    pictures = [(read_rgb(place.photos[query], long_side_px=_TILE_PX), "photo", "0.3")]
    window = true_window(place, query)
    if window is not None:
        truth = read_rgb(window[0].path, window[1], long_side_px=_TILE_PX)
        pictures.append((truth, "true place", "0.3"))
    for rank in range(found.tiles.shape[2] if found else 0):
        assert found is not None
        tile, hit = int(found.tiles[number, 0, rank]), bool(found.hits[number, 0, rank])
        if tile >= 0:
            title = f"{rank + 1} {'hit' if hit else 'miss'}"
            picture = read_tile(place, tile, _TILE_PX)
            pictures.append((picture, title, COLOURS[0] if hit else COLOURS[1]))
    wide = sheet.wide(1.6 * len(pictures))
    figure = new_canvas(wide, wide / len(pictures) + 0.2)
    panels = figure.subplots(1, len(pictures), squeeze=False)[0]
    for axes, (picture, title, colour) in zip(panels, pictures, strict=True):
        axes.imshow(picture)
        axes.set(xticks=[], yticks=[], title=label_text(title))
        axes.spines[:].set(color=colour, linewidth=2.5, linestyle="--" if "miss" in title else "-")
    finish(figure, sheet.noting(f"{query}: first tiles of {section.methods[number].name}"))
    return figure
