"""Pictures of retrieval: hits and misses on the map, and a query's photo beside its first tiles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.report.figures import COLOURS, Sheet, finish, label_text, new_canvas
from airzoo_bench.report.places import Place, draw_ground, read_tile, retrieved, true_window
from airzoo_bench.report.sections import Section

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_TILE_PX = 300


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
