"""Pictures of single runs of retrieval: hits and misses on the map, and the tiles of a query."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.geometry.arrays import Bools
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.report.figures import COLOURS, Sheet, default_style, finish, new_canvas
from airzoo_bench.report.sections import Place, Section, draw_ground, true_window
from airzoo_bench.retrieval.metrics import hit_matrix
from airzoo_bench.retrieval.track import RANKED_TILE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_RANKS, _TILE_PX = 5, 300
_BLUE, _ORANGE, _SKY = COLOURS[0], COLOURS[1], COLOURS[5]


@lru_cache(maxsize=8)
def first_tiles(section: Section, place: Place) -> tuple[NDArray[np.int32], Bools]:
    """Return the first tiles (M, Q, D) of each list, rows of the truth's or -1, and which answer.

    M methods, Q queries of the place, D ranks: none of other tracks.
    """
    methods, rows = section.methods, section.rows_of(place.scene)
    names = [f"{RANKED_TILE}{rank}" for rank in range(1, _MOST_RANKS + 1)]
    named = [name for name in names if all(name in m.records for m in methods)]
    shape = (len(methods), len(rows), len(named))
    tiles, hits = np.full(shape, -1, np.int32), np.zeros(shape, np.bool_)
    if named:
        index, positives = pd.Index(place.truth.tiles["id"]), place.truth.positives
        for number, method in enumerate(methods):
            for rank, name in enumerate(named):
                tiles[number, :, rank] = index.get_indexer(method.records[name].iloc[rows])
            hits[number] = hit_matrix(tiles[number], positives.offsets, positives.tiles, len(index))
    return tiles, hits


def read_tile(place: Place, tile: int, long_side_px: int) -> NDArray[np.uint8]:
    """Read the picture of a tile, which is a row of the truth's tiles."""
    assert place.gallery is not None
    row: Any = place.truth.tiles.iloc[tile]
    if "image" in row.index:
        return read_rgb(place.gallery / row["image"], long_side_px=long_side_px)
    x, y, width, height = (int(row[name]) for name in ("x", "y", "width", "height"))
    return read_rgb(place.gallery, (x, y, width, height), long_side_px=long_side_px)


@default_style()
def draw_hits(section: Section, place: Place, sheet: Sheet | None = None) -> Figure:
    """Draw on the map what photos show, by whether the first tile answers."""
    sheet = sheet or Sheet()
    figure, axes, metres = draw_ground(place, sheet)
    tiles, hits = first_tiles(section, place)
    if not tiles.shape[2]:
        raise UsageError("the records name no tiles", fix="score the predictions again")
    hit = hits[0, :, 0]
    for kind, colour, marker, name in ((~hit, _ORANGE, "x", "miss"), (hit, _SKY, "o", "hit")):
        style: Any = {"color": colour, "marker": marker, "linestyle": "none"}
        axes.plot(*(place.centres[kind] * metres).T, label=f"{name} ({int(kind.sum())})", **style)
    axes.legend(loc="best", fontsize=8)
    said = f"{section.names[0]}, scene {place.scene}: what photos show, by the first tile"
    finish(figure, sheet.noting(said))
    return figure


@default_style()
def draw_tiles(section: Section, place: Place, query: str, sheet: Sheet | None = None) -> Figure:
    """Draw a query's photo, its true place on the map, and the first tiles of its list."""
    pictures = [(read_rgb(place.photos[query], long_side_px=_TILE_PX), "photo", "0.3")]
    window = true_window(place, query)
    if window is not None:
        truth = read_rgb(window[0].path, window[1], long_side_px=_TILE_PX)
        pictures.append((truth, "true place", "0.3"))
    tiles, hits = (found[0, place.row_of(query)] for found in first_tiles(section, place))
    for rank, (tile, hit) in enumerate(zip(tiles.tolist(), hits.tolist(), strict=True), 1):
        if tile >= 0:
            title, colour = (f"{rank} hit", _BLUE) if hit else (f"{rank} miss", _ORANGE)
            pictures.append((read_tile(place, tile, _TILE_PX), title, colour))
    sheet = sheet or Sheet()
    wide = sheet.wide(1.6 * len(pictures))
    tallest = max(len(picture) / picture.shape[1] for picture, _, _ in pictures)
    figure = new_canvas(wide, wide / len(pictures) * tallest + 0.4)
    panels = figure.subplots(1, len(pictures), squeeze=False)[0]
    for axes, (picture, title, colour) in zip(panels, pictures, strict=True):
        axes.imshow(picture)
        axes.set(xticks=[], yticks=[], title=title)
        axes.spines[:].set(color=colour, linewidth=2.5, linestyle="--" if "miss" in title else "-")
    finish(figure, sheet.noting(f"{query}: first tiles of {section.names[0]}"))
    return figure
