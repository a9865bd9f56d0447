"""Single queries in a report: their table, where they are on maps, and which are the hardest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import RasterError, UserError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import gsd_m, read_rgb
from airzoo_bench.report.figures import Sheet, error_label, figure_bytes
from airzoo_bench.report.matching import arrow_factor, draw_matches, estimates_on_map, matches_text
from airzoo_bench.report.packing import Blobs, data_uri
from airzoo_bench.report.retrieval import first_tiles, query_pictures
from airzoo_bench.report.sections import Place, Section, jpeg
from airzoo_bench.results.comparison import is_hit
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.breakdown import UNKNOWN, condition_title, number_texts
from airzoo_bench.tables.comparison import HIT, MISS
from airzoo_bench.tables.layouts import score_texts

_MAP_PX, _SIDE_PX, _TILE_PX, _MATCHES_IN = 1400, 240, 120, 12.0
_STEPS_PER_PIXEL, _NOWHERE = 4, -32768  # places are kept to a quarter of a pixel of the picture


def pack_queries(section: Section, blobs: Blobs) -> dict[str, Any]:
    """Pack the table of queries: scores of all methods, and conditions."""
    records, scenes = section.methods[0].records, list(section.first.scenes)
    conditions, scores = [], []
    for name in section.conditions:
        column = records[name]
        numeric = column.dtype.kind in "iuf"
        values = column if numeric else column.fillna(UNKNOWN).astype(str)
        packed = blobs.codes(values.to_numpy(), _condition_texts if numeric else list)
        conditions.append(packed | {"title": condition_title(name), "numeric": numeric})
    for score in section.query_scores:
        packed = blobs.codes(_values(section, score.key), _writer(section, score))
        best = "descending" if score.higher_is_better else "ascending"
        judges = is_hit(section.track, score)
        scores.append(packed | {"title": _title(section, score), "best": best, "judges": judges})
    counts = [n for n in ("matches", "inliers") if all(n in m.records for m in section.methods)]
    for place, name in enumerate(counts, 1):
        packed = blobs.codes(_values(section, name), number_texts)
        scores.insert(place, packed | {"title": name, "best": "descending", "judges": False})
    failures = np.array([[*one.failures.values()] for one in section.alone])
    return {
        "count": len(records),
        "ids": blobs.json(records["query"].tolist()),
        "scene": blobs.array(np.array([scenes.index(one) for one in records["scene"]], np.int64)),
        "conditions": conditions,
        "scores": scores,
        "failures": blobs.codes(failures, list),
    }


def _values(section: Section, name: str) -> Floats:
    """Return the values (M, Q) of all methods."""
    return np.array([method.records[name].to_numpy(np.float64) for method in section.methods])


def _title(section: Section, score: ScoreColumn) -> str:
    return score.title if is_hit(section.track, score) else error_label(score)


def _writer(section: Section, score: ScoreColumn) -> Callable[[list[Any]], list[str]]:
    if is_hit(section.track, score):
        return lambda values: [HIT if value == 1 else MISS for value in values]
    return partial(score_texts, score)


def _condition_texts(values: list[float]) -> list[str]:
    known = [round(value, 2) for value in values if not np.isnan(value)]
    return number_texts(known) + ["–"] * (len(values) - len(known))


def pack_maps(
    section: Section, places: Sequence[Place], blobs: Blobs, notes: list[str]
) -> list[dict[str, Any]]:
    """Pack the maps of a section's scenes, with all that is drawn on them."""
    found = []
    side = int(_MAP_PX / max(1, len(places)) ** 0.5)
    for place in places if section.by_query else ():
        if place.dom is not None:
            try:
                found.append(_pack_map(section, place, side, blobs))
            except RasterError as error:
                notes.append(f"no map of scene {place.scene}: {error}")
    return found


def _pack_map(section: Section, place: Place, side: int, blobs: Blobs) -> dict[str, Any]:
    dom = place.dom
    assert dom is not None
    pixels = read_rgb(dom.path, long_side_px=side)
    scale = pixels.shape[1] / dom.width

    def pack(places: Floats) -> dict[str, Any]:
        steps = np.clip(np.round(places * scale * _STEPS_PER_PIXEL), 1 + _NOWHERE, -1 - _NOWHERE)
        return blobs.array(np.where(np.isfinite(steps), steps, _NOWHERE).astype(np.int64))

    packed = {
        "scene": list(section.first.scenes).index(place.scene),
        "picture": blobs.picture(data_uri(jpeg(pixels), "image/jpeg")),
        "width": pixels.shape[1],
        "height": pixels.shape[0],
        "metresPerPixel": gsd_m(dom)[0] / scale,
        "stepsPerPixel": _STEPS_PER_PIXEL,
        "nowhere": _NOWHERE,
        "rows": blobs.array(section.rows_of(place.scene)),
        "outlines": pack(place.outlines),
        "centres": pack(place.centres),
    }
    tiles, hits = map(np.array, zip(*(first_tiles(m, place) for m in section.alone), strict=True))
    if tiles.size:
        # Rank by rank, method by method: neighbours are then alike, and pack well.
        tiles = np.moveaxis(tiles, 2, 0)
        shown = np.unique(tiles[tiles >= 0])
        codes = np.where(tiles >= 0, np.searchsorted(shown, tiles), len(shown))
        packed |= {
            "ranks": len(tiles),
            "tiles": blobs.json(place.truth.tiles["id"].to_numpy()[shown].tolist()),
            "tileOutlines": pack(place.tiles[shown]),
            "ranked": blobs.array(codes),
            "hits": blobs.array((hits << np.arange(len(tiles))).sum(axis=2)),
        }
    estimates = [estimates_on_map(one, place) for one in section.alone]
    if any(one is not None for one in estimates):
        nothing = np.full(place.centres.shape, np.nan)
        gaps = np.array([nothing if one is None else one for one in estimates]) - place.centres
        factor = arrow_factor(np.linalg.norm(gaps, axis=2), max(dom.width, dom.height))
        packed |= {"factor": factor, "tips": pack(place.centres + factor * gaps)}
    return packed


def hardest_rows(section: Section, count: int) -> NDArray[np.intp]:
    """Return the rows of the queries that methods fail worst on, worst first, no hits of all.

    Shares go by their mean over methods, then and otherwise errors by the mean of their ranks.
    """
    first, *others = section.query_scores
    errors = [score for score in others if score.unit != "share"][: first.unit == "share"]
    keys = []
    for score in (first, *errors):
        values = _values(section, score.key) * (-1.0 if score.higher_is_better else 1.0)
        if score.unit != "share":
            values = np.array([np.searchsorted(np.sort(v), v).astype(np.float64) for v in values])
        keys.append(-values.mean(axis=0))
    order = np.lexsort(keys[::-1])
    if is_hit(section.track, first):
        order = order[_values(section, first.key).min(axis=0)[order] < 1]
    return order[:count]


def hardest(section: Section, places: Sequence[Place], count: int) -> list[dict[str, Any]]:
    """Return cards of the hardest queries, with pictures where the folder has them."""
    by_scene = {place.scene: place for place in places}
    records, score = section.methods[0].records, section.query_scores[0]
    values, title, cards = _values(section, score.key), _title(section, score), []
    for row in hardest_rows(section, count).tolist():
        query, place = str(records["query"].iloc[row]), by_scene.get(records["scene"].iloc[row])
        texts = _writer(section, score)(values[:, row].tolist())
        pairs = zip(texts, (one.failures[query] for one in section.alone), strict=True)
        texts = [", ".join(filter(None, pair)) for pair in pairs]
        named = [(f"{n}, {title}", text) for n, text in zip(section.names, texts, strict=True)]
        pictures = []
        for read, about in _sources(section, place, query) if place else ():
            with suppress(UserError):  # one that cannot be read is left out
                found = read()
                content = found if isinstance(found, bytes) else jpeg(found)
                pictures.append({**about, "src": data_uri(content, "image/jpeg")})
        cards.append({"query": query, "pictures": pictures, "values": named})
    return cards


def _sources(
    section: Section, place: Place, query: str
) -> Iterator[tuple[Callable[[], bytes | NDArray[np.uint8]], dict[str, Any]]]:
    """Yield functions that read pictures, and what is said of each."""
    if drawn := next((one for one in section.alone if matches_text(one, query)), None):
        limit = f"{section.first.protocol.settings['solver']['max_error_px']:g} px"
        title = f"matches of {drawn.names[0]}: {matches_text(drawn, query)}"
        draw = partial(draw_matches, drawn, place, query, Sheet(_MATCHES_IN), bare=True)
        about = {"title": title, "kind": "wide", "limit": limit}
        yield lambda: figure_bytes(draw(), "jpg", 90), about
    else:
        yield from query_pictures(section, place, query, _SIDE_PX, _TILE_PX)
