"""The queries that methods fail worst on, with small pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.errors import UserError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.report.maps import jpeg
from airzoo_bench.report.packing import data_uri
from airzoo_bench.report.places import Place
from airzoo_bench.report.sections import Section
from airzoo_bench.result import ScoreColumn

__all__ = ["hardest", "hardest_rows"]

_SIDE_PX = 240
_QUALITY = 70
_TOTAL_BYTES = 3 << 20

Pixels = NDArray[np.uint8]


def hardest_rows(section: Section, count: int) -> NDArray[np.intp]:
    """Rank queries by how badly the methods do on them, and return the rows of the first.

    By the mean over methods of the first headline score; where that is equal, of their rank by
    the first error in metres or degrees; then by id.
    """
    scores = section.query_scores
    errors = [score for score in scores if score.unit != "share"]
    keys = [_badness(section, scores[0])]
    keys += [_badness(section, errors[0])] if errors else []
    return np.lexsort([-key for key in reversed(keys)])[:count]


def _badness(section: Section, score: ScoreColumn) -> Floats:
    """Return the mean over methods (Q,): of a share, or of the rank of each error."""
    sign = -1.0 if score.higher_is_better else 1.0
    values = [sign * m.records[score.key].to_numpy(np.float64) for m in section.methods]
    if score.unit != "share":
        values = [np.searchsorted(np.sort(v), v, side="left").astype(np.float64) for v in values]
    mean: Floats = np.mean(values, axis=0)
    return mean


def hardest(section: Section, places: Sequence[Place], count: int) -> list[dict[str, Any]]:
    """Return the rows of the hardest queries, with pictures where the folder has them.

    Parameters
    ----------
    section : Section
    places : sequence of Place
    count : int
        How many queries; their pictures take no more than 3 MB together.
    """
    by_scene = {place.scene: place for place in places}
    records = section.methods[0].records
    left = _TOTAL_BYTES
    found = []
    for row in hardest_rows(section, count).tolist() if section.by_query else []:
        query = str(records["query"].iloc[row])
        place = by_scene.get(str(records["scene"].iloc[row]))
        pictures = [] if place is None or left <= 0 else list(_pictures(section, place, row, query))
        left -= sum(len(picture["src"]) for picture in pictures)
        found.append({"row": row, "pictures": pictures})
    return found


def _pictures(section: Section, place: Place, row: int, query: str) -> Iterator[dict[str, str]]:
    yield from _picture("photo", lambda: read_rgb(place.photos[query], long_side_px=_SIDE_PX))
    window = _true_window(place, query)
    if window is not None:
        yield from _picture(
            "the place on the map", lambda: read_rgb(place.dom.path, window, long_side_px=_SIDE_PX)
        )
    tile = _first_tile(section, place, row)
    if tile is not None:
        title = f"first tile of {section.methods[0].name}"
        yield from _picture(title, lambda: read_rgb(place.gallery, tile, long_side_px=_SIDE_PX))


def _picture(title: str, read: Callable[[], Pixels]) -> Iterator[dict[str, str]]:
    """Yield a picture, or nothing where it cannot be read: a report is made without it."""
    try:
        content = jpeg(read(), _QUALITY)
    except UserError:
        return
    yield {"title": title, "src": data_uri(content, "image/jpeg")}


def _true_window(place: Place, query: str) -> tuple[int, int, int, int] | None:
    if query in place.crops:
        x, y, width, height = place.crops[query]
        return x, y, width, height
    outline = place.outlines[place.queries.index(query)]
    if not np.isfinite(outline).all():
        return None
    size = (place.dom.width, place.dom.height)
    low = np.clip(np.floor(outline.min(axis=0)), 0, size).astype(int)
    high = np.clip(np.ceil(outline.max(axis=0)), 0, size).astype(int)
    if not (high > low).all():
        return None
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def _first_tile(section: Section, place: Place, row: int) -> tuple[int, int, int, int] | None:
    """Return the window of the tile that the first method ranked first."""
    records = section.methods[0].records
    if place.tiles is None or "first_tile" not in records:
        return None
    found = place.tiles[place.tiles["id"] == records["first_tile"].iloc[row]]
    if found.empty:
        return None
    x, y, width, height = found[["x", "y", "width", "height"]].iloc[0].tolist()
    return int(x), int(y), int(width), int(height)
