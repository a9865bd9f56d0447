"""Pictures of single runs of retrieval: hits and misses on the map, and the tiles of a query."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.geometry.arrays import Bools
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.report.figures import COLOURS, Sheet, default_style, finish, new_canvas
from airzoo_bench.report.sections import Place, Section, draw_ground, mark_failures, true_window
from airzoo_bench.retrieval.metrics import hit_matrix
from airzoo_bench.retrieval.track import RANKED_TILE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_RANKS, _TILE_PX = 5, 300
_ORANGE, _SKY = COLOURS[1], COLOURS[5]
_FRAMES = {"hit": (COLOURS[0], "-"), "miss": (_ORANGE, "--")}  # of tiles: colour and line


@lru_cache(maxsize=8)
def first_tiles(section: Section, place: Place) -> tuple[NDArray[np.int32], Bools]:
    """Return the first tiles (Q, D) of the first method, rows of the truth's or -1, and which hit.

    Q queries of the place, D ranks: none of other tracks.
    """
    records = section.methods[0].records.iloc[section.rows_of(place.scene)]
    names = (f"{RANKED_TILE}{rank}" for rank in range(1, _MOST_RANKS + 1))
    named = [name for name in names if name in records]
    tiles = np.full((len(records), len(named)), -1, np.int32)
    if not named:
        return tiles, tiles >= 0
    index, positives = pd.Index(place.truth.tiles["id"]), place.truth.positives
    for rank, name in enumerate(named):
        tiles[:, rank] = index.get_indexer(records[name])
    return tiles, hit_matrix(tiles, positives.offsets, positives.tiles, len(index))


def read_tile(place: Place, tile: int, long_side_px: int) -> NDArray[np.uint8]:
    """Read the picture of a tile, which is a row of the truth's tiles."""
    assert place.gallery is not None
    row: Any = place.truth.tiles.iloc[tile]
    if "image" in row.index:
        return read_rgb(place.gallery / row["image"], long_side_px=long_side_px)
    x, y, width, height = (int(row[name]) for name in ("x", "y", "width", "height"))
    return read_rgb(place.gallery, (x, y, width, height), long_side_px=long_side_px)


def query_pictures(
    section: Section, place: Place, query: str, side_px: int, tile_px: int
) -> Iterator[tuple[Callable[[], NDArray[np.uint8]], dict[str, Any]]]:
    """Yield functions that read photo, true place and first tiles of a query, each with a title."""
    yield partial(read_rgb, place.photos[query], long_side_px=side_px), {"title": "photo"}
    if window := true_window(place, query):
        read = partial(read_rgb, window[0].path, window[1], long_side_px=side_px)
        yield read, {"title": "true place"}
    found, hits = (array[place.row_of(query)] for array in first_tiles(section, place))
    for rank, (tile, hit) in enumerate(zip(found.tolist(), hits.tolist(), strict=True), 1):
        if tile >= 0:
            title, kind = str(place.truth.tiles["id"].iloc[tile]), "hit" if hit else "miss"
            about = {"title": title, "rank": rank, "kind": kind}
            yield partial(read_tile, place, tile, tile_px), about


@default_style()
def draw_hits(section: Section, place: Place, sheet: Sheet) -> Figure:
    """Draw on the map what photos show, by whether the first tile answers."""
    figure, axes, metres = draw_ground(place, sheet)
    tiles, hits = first_tiles(section, place)
    if not tiles.shape[1]:
        raise UsageError("the records name no tiles", fix="score the predictions again")
    hit, failed = hits[:, 0], mark_failures(section, place, axes, metres)
    missed = ~hit & ~failed
    for kind, colour, marker, name in ((missed, _ORANGE, "x", "miss"), (hit, _SKY, "o", "hit")):
        style: Any = {"color": colour, "marker": marker, "linestyle": "none"}
        axes.plot(*(place.centres[kind] * metres).T, label=f"{name} ({int(kind.sum())})", **style)
    axes.legend(loc="best", fontsize=8)
    said = f"{section.names[0]}, scene {place.scene}: what photos show, by the first tile"
    finish(figure, sheet.noting(said))
    return figure


@default_style()
def draw_tiles(section: Section, place: Place, query: str, sheet: Sheet) -> Figure:
    """Draw a query's photo, its true place on the map, and the first tiles of its list."""
    found = query_pictures(section, place, query, _TILE_PX, _TILE_PX)
    pictures = [(read(), about) for read, about in found]
    wide = sheet.wide(1.6 * len(pictures))
    tallest = max(len(picture) / picture.shape[1] for picture, _ in pictures)
    figure = new_canvas(wide, wide / len(pictures) * tallest + 0.4)
    panels = figure.subplots(1, len(pictures), squeeze=False)[0]
    for axes, (picture, about) in zip(panels, pictures, strict=True):
        kind = about.get("kind", "")
        axes.imshow(picture)
        axes.set(xticks=[], yticks=[], title=f"{about['rank']} {kind}" if kind else about["title"])
        colour, dashes = _FRAMES.get(kind, ("0.3", "-"))
        axes.spines[:].set(color=colour, linewidth=2.5, linestyle=dashes)
    said = section.failures[query] or f"first tiles of {section.names[0]}"
    finish(figure, sheet.noting(f"{query}: {said}"))
    return figure
