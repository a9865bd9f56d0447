"""The queries that methods fail worst on, with small pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UserError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import RasterInfo, read_rgb
from airzoo_bench.report.labels import error_label
from airzoo_bench.report.maps import jpeg, retrieved
from airzoo_bench.report.packing import data_uri
from airzoo_bench.report.places import Place
from airzoo_bench.report.sections import Section
from airzoo_bench.results.result import ScoreColumn

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["hardest", "hardest_rows", "order_said"]

_SIDE_PX = 240
_TILE_PX = 120
_QUALITY = 70
_TOTAL_BYTES = 3 << 20

Pixels = NDArray[np.uint8]


def hardest_rows(section: Section, count: int) -> NDArray[np.intp]:
    """Rank queries by how badly the methods do on them, and return the rows of the first."""
    keys = [_badness(section, score) for score in _ordering(section)]
    return np.lexsort([-key for key in reversed(keys)])[:count]


def order_said(section: Section) -> str:
    """Describe the ranking of `hardest_rows`."""
    mean = "the mean over methods of " if len(section.methods) > 1 else ""
    said = []
    for score in _ordering(section):
        title = score.title if score.unit == "share" else error_label(score)
        ranks = mean and score.unit != "share"
        said.append(f"by {mean}{'its place among the queries by ' if ranks else ''}{title}")
    return f"Worst first, {', then '.join(said)}."


def _ordering(section: Section) -> list[ScoreColumn]:
    first, *others = section.query_scores
    errors = [score for score in others if score.unit != "share"]
    return [first] if first.unit != "share" else [first, *errors[:1]]


def _badness(section: Section, score: ScoreColumn) -> Floats:
    """Return the mean over methods (Q,): of a share, or of the rank of each error."""
    sign = -1.0 if score.higher_is_better else 1.0
    values = [sign * m.records[score.key].to_numpy(np.float64) for m in section.methods]
    if score.unit != "share":
        values = [np.searchsorted(np.sort(v), v, side="left").astype(np.float64) for v in values]
    mean: Floats = np.mean(values, axis=0)
    return mean


def hardest(
    section: Section, places: Sequence[Place], count: int, notes: list[str]
) -> list[dict[str, Any]]:
    """Return the rows of the hardest queries, with pictures where the folder has them."""
    by_scene = {place.scene: place for place in places}
    records = section.methods[0].records
    left, bare = _TOTAL_BYTES, 0
    found: list[dict[str, Any]] = []
    for row in hardest_rows(section, count).tolist() if section.by_query else []:
        place = by_scene.get(str(records["scene"].iloc[row]))
        card: dict[str, Any] = {"row": row, "pictures": [], "tiles": []}
        if place is not None:
            query = str(records["query"].iloc[row])
            card["pictures"] = list(_pictures(place, query))
            card["tiles"] = list(_tiles(section, place, row))
            size = sum(len(picture["src"]) for picture in card["pictures"] + card["tiles"])
            if size > left:
                card["pictures"], card["tiles"], bare = [], [], bare + 1
            else:
                left -= size
        found.append(card)
    if bare:
        name = section.first.protocol.name
        notes.append(
            f"no pictures of {bare} of the {len(found)} hardest queries of {name}: "
            f"pictures take at most {_TOTAL_BYTES >> 20} MB"
        )
    return found


def _pictures(place: Place, query: str) -> Iterator[dict[str, Any]]:
    yield from _picture(lambda: read_rgb(place.photos[query], long_side_px=_SIDE_PX), title="photo")
    dom = place.dom
    window = None if dom is None else _true_window(place, dom, query)
    if dom is not None and window is not None:
        yield from _picture(
            lambda: read_rgb(dom.path, window, long_side_px=_SIDE_PX),
            title="the place on the map",
        )


def _tiles(section: Section, place: Place, row: int) -> Iterator[dict[str, Any]]:
    """Yield the first tiles of the first method."""
    found = retrieved(section, place, np.array([row]))
    if found is None or place.tiles is None:
        return
    for rank, (tile, hit) in enumerate(zip(found.tiles[0, 0], found.hits[0, 0], strict=True), 1):
        if tile < 0:
            continue
        yield from _picture(
            partial(_tile, place.gallery, place.tiles.iloc[tile]),
            title=str(place.tiles["id"].iloc[tile]),
            rank=rank,
            hit=bool(hit),
        )


def _tile(gallery: Path, tile: pd.Series[Any]) -> Pixels:
    if "image" in tile.index:
        return read_rgb(gallery / tile["image"], long_side_px=_TILE_PX)
    x, y, width, height = (int(tile[name]) for name in ("x", "y", "width", "height"))
    return read_rgb(gallery, (x, y, width, height), long_side_px=_TILE_PX)


def _picture(read: Callable[[], Pixels], **said: object) -> Iterator[dict[str, Any]]:
    """Yield a picture, or nothing if it cannot be read: the report does without it."""
    try:
        content = jpeg(read(), _QUALITY)
    except UserError:
        return
    yield {**said, "src": data_uri(content, "image/jpeg")}


def _true_window(place: Place, dom: RasterInfo, query: str) -> tuple[int, int, int, int] | None:
    if query in place.crops:
        x, y, width, height = place.crops[query]
        return x, y, width, height
    outline = place.outlines[place.queries.index(query)]
    if not np.isfinite(outline).all():
        return None
    size = (dom.width, dom.height)
    low = np.clip(np.floor(outline.min(axis=0)), 0, size).astype(int)
    high = np.clip(np.ceil(outline.max(axis=0)), 0, size).astype(int)
    if not (high > low).all():
        return None
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])
