"""Maps of a report: the map's picture, and the outlines and tiles drawn over it."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, read_rgb
from airzoo_bench.report.packing import Blobs, data_uri
from airzoo_bench.report.places import Place
from airzoo_bench.report.sections import Section, tile_columns
from airzoo_bench.retrieval.metrics import hit_matrix

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Retrieved", "jpeg", "maps", "retrieved"]

_LONG_SIDE_PX = 1600
_TOTAL_BYTES = 4 << 20
_MOST_BYTES = 900 << 10
_QUALITY = 72
_STEPS_PER_PIXEL = 4  # outlines are kept to a quarter of a pixel of the picture
_NOWHERE = -32768


def jpeg(pixels: NDArray[np.uint8], quality: int = _QUALITY) -> bytes:
    """Write a picture (height, width, 3) as JPEG."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=quality, optimize=True)
    return stream.getvalue()


def maps(
    section: Section, places: Sequence[Place], blobs: Blobs, notes: list[str]
) -> list[dict[str, Any]]:
    """Pack the maps of a section's scenes."""
    share = min(_MOST_BYTES, _TOTAL_BYTES // max(len(places), 1))
    unmapped = [place.scene for place in places if place.dom is None]
    if unmapped:
        whose = "it has" if len(unmapped) == 1 else "they have"
        notes.append(f"no map of {', '.join(unmapped)}: {whose} many small ones, or images only")
    found = []
    for place in places:
        if place.dom is None:
            continue
        try:
            found.append(_map(section, place, place.dom, share, blobs))
        except RasterError as error:
            notes.append(f"no map of scene {place.scene}: {error}")
    return found


def _map(
    section: Section, place: Place, dom: RasterInfo, most_bytes: int, blobs: Blobs
) -> dict[str, Any]:
    content, width, height = _picture(dom, most_bytes)
    scale = width / dom.width
    records = section.methods[0].records
    rows = np.flatnonzero((records["scene"] == place.scene).to_numpy(bool))
    known = {query: row for row, query in enumerate(place.queries)}
    order = np.array([known[query] for query in records["query"].iloc[rows]], np.intp)
    packed = {
        "scene": place.scene,
        "picture": data_uri(content, "image/jpeg"),
        "width": width,
        "height": height,
        "metresPerPixel": gsd_m(dom)[0] / scale,
        "rows": blobs.array(rows),
        "outlines": blobs.array(_steps(place.outlines[order] * scale)),
        "centres": blobs.array(_steps(place.centres[order] * scale)),
        "stepsPerPixel": _STEPS_PER_PIXEL,
        "nowhere": _NOWHERE,
    }
    return packed | _tiles(section, place, rows, scale, blobs)


def _picture(dom: RasterInfo, most_bytes: int) -> tuple[bytes, int, int]:
    """Return the map as JPEG of at most `most_bytes`, with its width and height."""
    side = min(_LONG_SIDE_PX, max(dom.width, dom.height))
    pixels = read_rgb(dom.path, long_side_px=side)
    content = jpeg(pixels)
    while len(content) > most_bytes and side > 64:
        side = int(side * min(0.9, (most_bytes / len(content)) ** 0.5))
        pixels = read_rgb(dom.path, long_side_px=side)
        content = jpeg(pixels)
    return content, pixels.shape[1], pixels.shape[0]


def _steps(pixels: Floats) -> NDArray[np.int64]:
    limit = -_NOWHERE - 1
    steps = np.clip(np.round(pixels * _STEPS_PER_PIXEL), -limit, limit)
    return np.where(np.isfinite(pixels), steps, _NOWHERE).astype(np.int64)


def _tiles(
    section: Section, place: Place, rows: NDArray[np.intp], scale: float, blobs: Blobs
) -> dict[str, Any]:
    """Pack the tiles that methods have retrieved: at which rank, and whether they are hits."""
    found = retrieved(section, place, rows)
    if found is None or place.tiles is None:
        return {}
    # Rank by rank, method by method: neighbours are then alike, and pack well.
    tiles = np.moveaxis(found.tiles, 2, 0)
    shown = np.unique(tiles[tiles >= 0])
    codes = np.where(tiles >= 0, np.searchsorted(shown, tiles), len(shown))
    bits = (found.hits << np.arange(found.hits.shape[2])).sum(axis=2)
    return {
        "tiles": blobs.json(place.tiles["id"].to_numpy()[shown].tolist()),
        "tileOutlines": blobs.array(_steps(place.tile_outlines[shown] * scale)),
        "ranks": len(tiles),
        "ranked": blobs.array(codes),
        "hits": blobs.array(bits),
    }


@dataclass(frozen=True, eq=False)
class Retrieved:
    """First tiles of M methods on Q queries of a scene, at D ranks.

    Attributes
    ----------
    tiles : (M, Q, D) int32
        Rows of the scene's tiles; -1 where a list is shorter, or records do not say.
    hits : (M, Q, D) bool
        Which of them are positives of the query.
    """

    tiles: NDArray[np.int32]
    hits: NDArray[np.bool_]


def retrieved(section: Section, place: Place, rows: NDArray[np.intp]) -> Retrieved | None:
    """Find the first tiles of queries in the truth of their scene."""
    found = [tile_columns(method.records.columns) for method in section.methods]
    depth = max(map(len, found))
    if place.tiles is None or place.positives is None or not depth:
        return None
    import pandas as pd

    index = pd.Index(place.tiles["id"])
    known = {query: row for row, query in enumerate(place.queries)}
    order = np.array([known[q] for q in section.methods[0].records["query"].iloc[rows]], np.intp)
    tiles = np.full((len(section.methods), len(rows), depth), -1, np.int32)
    hits = np.zeros(tiles.shape, np.bool_)
    # In the order of the truth, whose positives are looked up; a query is in it once.
    ranked = np.full((len(place.queries), depth), -1, np.int32)
    for number, (method, columns) in enumerate(zip(section.methods, found, strict=True)):
        tiles[number, :, : len(columns)] = _indices(method.records, columns, rows, index)
        ranked[order] = tiles[number]
        offsets, positives = place.positives.offsets, place.positives.tiles
        hits[number] = hit_matrix(ranked, offsets, positives, len(index))[order]
    return Retrieved(tiles, hits)


def _indices(
    records: pd.DataFrame, columns: Sequence[str], rows: NDArray[np.intp], index: pd.Index[str]
) -> NDArray[np.int32]:
    import pandas as pd

    found = np.full((len(rows), len(columns)), -1, np.int32)
    for rank, name in enumerate(columns):
        found[:, rank] = index.get_indexer(pd.Index(records[name].iloc[rows]))
    return found
