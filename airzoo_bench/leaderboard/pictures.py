"""The pictures of a method's page: its queries on maps, the hardest of them, or its clouds."""

from __future__ import annotations

import json
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import TRACKS, resolve
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.leaderboard.answers import PICTURES_FILE
from airzoo_bench.report.matching import arrow_factor, estimates_on_map
from airzoo_bench.report.packing import data_uri
from airzoo_bench.report.queries import hardest
from airzoo_bench.report.sections import Place, Section, jpeg, places_of
from airzoo_bench.results.comparison import is_hit
from airzoo_bench.results.records import Method

_HARDEST = 4
_MAPS_PX, _CLOUD_PX, _QUALITY = 760, 1100, 50


def draw_pictures(evaluation: Evaluation, run: Run, folder: Path) -> None:
    """Write the pictures of a run into its folder; a benchmark without photos or maps has none."""
    result, titles = evaluation.result, evaluation.result.truth.scene_titles
    with suppress(UserError), tempfile.TemporaryDirectory() as kept:
        if draw := TRACKS.get(result.track).figures:
            resolve(draw)(evaluation, run, Path(kept))
        method = Method(result.predictions.method, result, evaluation.records)
        section = Section([method], [Path(kept)])
        clouds = {titles[scene]: Path(kept, f"figures/{scene}_cloud.png") for scene in titles}
        found: dict[str, Any] = {"maps": [], "hardest": []}
        found["clouds"] = [(t, _picture(p, _CLOUD_PX)) for t, p in clouds.items() if p.is_file()]
        if section.by_query:
            places = places_of(section, evaluation.benchmark)
            side = int(_MAPS_PX / len(places) ** 0.5)
            found["maps"] = [_draw_map(section, place, side) for place in places if place.dom]
            found["hardest"] = hardest(section, places, _HARDEST)
        (folder / PICTURES_FILE).parent.mkdir()
        (folder / PICTURES_FILE).write_text(json.dumps(found), encoding="utf-8")


def _picture(path: Path, long_side_px: int) -> str:
    return data_uri(jpeg(read_rgb(path, long_side_px=long_side_px), _QUALITY), "image/jpeg")


def _draw_map(section: Section, place: Place, side_px: int) -> dict[str, Any]:
    """Return a map with paths for SVG: of hits, of misses, and of known errors."""
    dom, score = place.dom, next(s for s in section.scores if is_hit(section.track, s))
    assert dom is not None
    scale, paths = side_px / max(dom.width, dom.height), dict[str, str]()
    records = section.methods[0].records.iloc[section.rows_of(place.scene)]
    hits = records[score.key].to_numpy(np.float64) == 1
    for name, chosen in (("miss", ~hits), ("hit", hits)):
        paths[f"{name} outline"] = _path(place.outlines[chosen] * scale)
        paths[f"{name} dot"] = _path(place.centres[chosen, None] * scale)
    factor, estimates = 0, estimates_on_map(section, place)
    if estimates is not None:
        gaps = estimates - place.centres
        factor = arrow_factor(np.linalg.norm(gaps, axis=1), max(dom.width, dom.height))
        ends = np.stack([place.centres, place.centres + factor * gaps], axis=1)
        paths["arrow"] = _path(ends * scale)
    title, picture = section.first.truth.scene_titles[place.scene], _picture(dom.path, side_px)
    size = {"width": dom.width * scale, "height": dom.height * scale, "factor": factor}
    counts = {"hits": int(hits.sum()), "queries": len(hits), "score": score.title}
    return {"title": title, "picture": picture, "paths": paths, **size, **counts}


def _path(shapes: Floats) -> str:
    """Return the known of closed shapes (N, K, 2) as a path of SVG, in which a point is a dot."""
    known = shapes[np.isfinite(shapes).all(axis=(1, 2))].round().astype(int)
    return "".join(f"M{'L'.join(f'{x} {y}' for x, y in shape)}z" for shape in known.tolist())
