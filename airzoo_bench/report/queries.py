"""Single queries in a report: their table, where they are on maps, and which are the hardest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import RasterError, UserError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, read_rgb
from airzoo_bench.report.figures import error_label, figure_bytes, heading
from airzoo_bench.report.matching import arrow_factor, draw_matches, estimates_on_map, has_matches
from airzoo_bench.report.packing import Blobs, data_uri
from airzoo_bench.report.places import Place, Window, jpeg, read_tile, retrieved, true_window
from airzoo_bench.report.sections import Section
from airzoo_bench.results.comparison import is_hit
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.breakdown import condition_title
from airzoo_bench.tables.intervals import score_texts
from airzoo_bench.tables.model import Cell

_LONG_SIDE_PX, _SIDE_PX, _TILE_PX = 1600, 240, 120
_MAPS_BYTES, _MAP_BYTES, _PICTURES_BYTES = 1536 << 10, 800 << 10, 1 << 20
_STEPS_PER_PIXEL = 4  # places are kept to a quarter of a pixel of the map's picture
_NOWHERE = -32768
_Source = tuple[Callable[[], bytes], dict[str, Any]]


def pack_queries(section: Section, blobs: Blobs) -> dict[str, Any] | None:
    """Pack the table of queries; None if each record is a scene."""
    if not section.by_query:
        return None
    records, scenes = section.methods[0].records, list(section.first.scenes)
    return {
        "count": len(records),
        "ids": blobs.json(records["query"].tolist()),
        "scene": blobs.array(np.array([scenes.index(one) for one in records["scene"]], np.int64)),
        "conditions": [_pack_condition(section, name, blobs) for name in section.conditions],
        "scores": [_pack_score(section, score, blobs) for score in section.query_scores],
    }


def _pack_score(section: Section, score: ScoreColumn, blobs: Blobs) -> dict[str, Any]:
    values = [m.records[score.key].to_numpy(np.float64) for m in section.methods]
    hits = is_hit(section.track, score)
    packed = blobs.numbers(np.array(values), _writer(section, score))
    title = score.title if hits else f"{error_label(score)}"
    best = "descending" if score.higher_is_better else "ascending"
    hit = int(np.unique(values).searchsorted(1.0)) if hits else -1
    return packed | {"title": title, "heading": heading(score), "best": best, "hit": hit}


def _writer(section: Section, score: ScoreColumn) -> Callable[[Floats], list[str]]:
    if is_hit(section.track, score):
        return lambda values: ["✓ hit" if value == 1 else "✗ miss" for value in values]
    return partial(score_texts, score)


def _pack_condition(section: Section, name: str, blobs: Blobs) -> dict[str, Any]:
    column = section.methods[0].records[name]
    numeric = column.dtype.kind in "iuf"
    if numeric:
        packed = blobs.numbers(column.to_numpy(np.float64), _condition_texts)
    else:
        packed = blobs.words(column.fillna("unknown").astype(str))
    return packed | {"title": condition_title(name), "numeric": numeric}


def _condition_texts(values: Floats) -> list[str]:
    """Write numbers with decimals that suit the largest one."""
    finite = values[np.isfinite(values)]
    most = np.abs(finite).max(initial=0.0)
    whole = (finite == np.round(finite)).all() or most >= 1000
    return [Cell(value).text(0 if whole else 2 if most >= 1 else 4) for value in values.tolist()]


def pack_maps(
    section: Section, places: Sequence[Place], blobs: Blobs, notes: list[str]
) -> list[dict[str, Any]]:
    """Pack the maps of a section's scenes, with all that is drawn on them."""
    found, share = [], min(_MAP_BYTES, _MAPS_BYTES // max(len(places), 1))
    for place in places if section.by_query else ():
        try:
            if place.dom is not None:
                found.append(_pack_map(section, place, place.dom, share, blobs))
            else:
                notes.append(f"no map of scene {place.scene}: it has images, or many small maps")
        except RasterError as error:
            notes.append(f"no map of scene {place.scene}: {error}")
    return found


def _pack_map(
    section: Section, place: Place, dom: RasterInfo, most_bytes: int, blobs: Blobs
) -> dict[str, Any]:
    content, width, height = _map_picture(dom, most_bytes)
    scale, rows = width / dom.width, section.rows_of(place.scene)
    order = place.rows_of(section.methods[0].records["query"].iloc[rows])

    def pack(pixels: Floats) -> dict[str, Any]:
        limit = -_NOWHERE - 1
        steps = np.clip(np.round(pixels * scale * _STEPS_PER_PIXEL), -limit, limit)
        return blobs.array(np.where(np.isfinite(steps), steps, _NOWHERE).astype(np.int64))

    packed = {
        "scene": list(section.first.scenes).index(place.scene),
        "picture": blobs.picture(data_uri(content, "image/jpeg")),
        "width": width,
        "height": height,
        "metresPerPixel": gsd_m(dom)[0] / scale,
        "stepsPerPixel": _STEPS_PER_PIXEL,
        "nowhere": _NOWHERE,
        "rows": blobs.array(rows),
        "outlines": pack(place.outlines[order]),
        "centres": pack(place.centres[order]),
    }
    found = retrieved(section, place, rows)
    if found is not None and place.tiles is not None:
        # Rank by rank, method by method: neighbours are then alike, and pack well.
        tiles = np.moveaxis(found.tiles, 2, 0)
        shown = np.unique(tiles[tiles >= 0])
        codes = np.where(tiles >= 0, np.searchsorted(shown, tiles), len(shown))
        packed |= {
            "ranks": len(tiles),
            "tiles": blobs.json(place.tiles["id"].to_numpy()[shown].tolist()),
            "tileOutlines": pack(place.tile_outlines[shown]),
            "ranked": blobs.array(codes),
            "hits": blobs.array((found.hits << np.arange(len(tiles))).sum(axis=2)),
        }
    estimates = [estimates_on_map(section, place, n) for n in range(len(section.folders))]
    nothing = np.full(place.centres.shape, np.nan)
    if any(one is not None for one in estimates):
        places = np.array([nothing if one is None else one for one in estimates])
        gaps = places - place.centres
        factor = arrow_factor(np.linalg.norm(gaps, axis=2), max(dom.width, dom.height))
        packed |= {"factor": factor, "tips": pack((place.centres + factor * gaps)[:, order])}
    return packed


def _map_picture(dom: RasterInfo, most_bytes: int) -> tuple[bytes, int, int]:
    """Return the map as JPEG of at most `most_bytes`, with its width and height."""
    side = min(_LONG_SIDE_PX, max(dom.width, dom.height))
    while True:
        pixels = read_rgb(dom.path, long_side_px=side)
        content = jpeg(pixels)
        if len(content) <= most_bytes or side <= 64:
            return content, pixels.shape[1], pixels.shape[0]
        side = int(side * min(0.9, (most_bytes / len(content)) ** 0.5))


def hardest_rows(section: Section, count: int) -> NDArray[np.intp]:
    """Return the rows of the queries that methods fail worst on, worst first, no hits of all."""
    keys = [_badness(section, score) for score in _ordering(section)]
    order = np.lexsort([-key for key in reversed(keys)])
    first = section.query_scores[0]
    if is_hit(section.track, first):
        missed = np.min([m.records[first.key] for m in section.methods], axis=0) < 1
        order = order[missed[order]]
    return order[:count]


def order_said(section: Section) -> str:
    """Describe the order of `hardest_rows`."""
    mean = "the mean over methods of " if len(section.methods) > 1 else ""
    parts = []
    for score in _ordering(section):
        title = score.title if score.unit == "share" else error_label(score)
        ranks = mean and score.unit != "share"
        parts.append(f"by {mean}{'its place among the queries by ' if ranks else ''}{title}")
    first = section.query_scores[0]
    misses = is_hit(section.track, first)
    missed = f" Queries that {'every' if mean else 'the'} method hits are left out." * misses
    return f"Worst first, {', then '.join(parts)}.{missed}"


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
    """Return cards of the hardest queries, with pictures where the folder has them."""
    by_scene = {place.scene: place for place in places}
    records, first = section.methods[0].records, section.query_scores[0]
    values = np.array([m.records[first.key].to_numpy(np.float64) for m in section.methods])
    left, bare, cards = _PICTURES_BYTES, 0, []
    for row in hardest_rows(section, count).tolist():
        query, place = str(records["query"].iloc[row]), by_scene.get(records["scene"].iloc[row])
        pictures = list(_pictures(section, place, query, row)) if place else []
        size = sum(len(picture["src"]) for picture in pictures)
        if size > left:
            pictures, bare = [], bare + 1
        left -= size if pictures else 0
        texts = _writer(section, first)(values[:, row])
        named = list(zip([m.name for m in section.methods], texts, strict=True))
        cards.append({"query": query, "pictures": pictures, "values": named})
    if bare:
        name = section.first.protocol.name
        notes.append(
            f"no pictures of {bare} of the {len(cards)} hardest queries of {name}: "
            f"pictures take at most {_PICTURES_BYTES >> 20} MB"
        )
    return cards


def _pictures(section: Section, place: Place, query: str, row: int) -> Iterator[dict[str, Any]]:
    """Yield the pictures of a query; those that cannot be read are left out."""
    for read, about in _sources(section, place, query, row):
        with suppress(UserError):
            yield {**about, "src": data_uri(read(), "image/jpeg")}


def _sources(section: Section, place: Place, query: str, row: int) -> Iterator[_Source]:
    """Yield functions that read pictures, and what is said of each."""
    for number, folder in enumerate(section.folders if place.matching else ()):
        if has_matches(folder, query):
            about = {"title": f"matches of {section.methods[number].name}", "kind": "wide"}
            yield partial(_matches_jpeg, section, place, query, number), about
            return
    yield partial(_read_jpeg, place.photos[query]), {"title": "photo"}
    window = true_window(place, query)
    if window is not None:
        yield partial(_read_jpeg, window[0].path, window[1]), {"title": "the place on the map"}
    found = retrieved(section, place, np.array([row]))
    if found is None or place.tiles is None:
        return
    for rank, (tile, hit) in enumerate(zip(found.tiles[0, 0], found.hits[0, 0], strict=True), 1):
        if tile >= 0:
            title = str(place.tiles["id"].iloc[tile])
            kind = "hit" if hit else "miss"
            yield (
                partial(_tile_jpeg, place, int(tile)),
                {"title": title, "kind": kind, "rank": rank},
            )


def _read_jpeg(path: Path, window: Window | None = None) -> bytes:
    return jpeg(read_rgb(path, window, long_side_px=_SIDE_PX), 70)


def _matches_jpeg(section: Section, place: Place, query: str, number: int) -> bytes:
    return figure_bytes(draw_matches(section, place, query, number=number), "jpg", 90)


def _tile_jpeg(place: Place, tile: int) -> bytes:
    return jpeg(read_tile(place, tile, _TILE_PX), 70)
