"""Clouds in a report: points and the colours of their errors, packed for the page to turn."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from airzoo_bench.core.errors import UserError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import read_rgb
from airzoo_bench.report.figures import error_codes, error_colours
from airzoo_bench.report.packing import Blobs, data_uri
from airzoo_bench.report.places import Place, jpeg
from airzoo_bench.report.reconstruction import error_limit, read_clouds
from airzoo_bench.report.sections import Section

_CLOUDS_BYTES, _POINT_BYTES, _PHOTO_PX = 1536 << 10, 8, 800
_FRAME = (0.2, 99.8)  # percentiles of the true points; a few strays would make all else a dot


def pack_clouds(section: Section, places: Sequence[Place], blobs: Blobs) -> list[dict[str, Any]]:
    """Pack predicted and true cloud of each scene and method, where runs have kept them."""
    kept = [read_clouds(folder) for folder in section.folders]
    kept = kept if section.track == "reconstruction" else []
    photos = {place.scene: _photo(place) for place in places} if any(kept) else {}
    most = _CLOUDS_BYTES // (2 * _POINT_BYTES * max(1, sum(map(len, kept))))
    packed = []
    for scene, title in section.first.truth.scene_titles.items():
        every = [found[scene] for found in kept if scene in found]
        photo = blobs.picture(photos[scene]) if photos.get(scene) else -1
        limits = [
            error_limit([one.precision_m for one in every]),
            error_limit([one.recall_m for one in every]),
        ]
        for method, found in zip(section.methods, kept, strict=False):
            if scene not in found:
                continue
            one = found[scene]
            clouds = (
                ("predicted", "truth", one.predicted, one.precision_m),
                ("true", "prediction", one.true, one.recall_m),
            )
            for (which, other, points, errors), limit in zip(clouds, limits, strict=True):
                cloud = _pack_cloud(points, errors, limit, one.true, most, blobs)
                about = f"distance to the {other}, from 0 to {limit:g} m; vermilion: farther"
                name = f"{title}: {method.name}, {which} points"
                packed.append(cloud | {"title": name, "about": about, "photo": photo})
    return packed


def _pack_cloud(
    points: Floats, errors: Floats, limit: float, true: Floats, most: int, blobs: Blobs
) -> dict[str, Any]:
    """Pack points within a cube around the true ones in 16 bits a coordinate, errors in 8."""
    low, high = np.percentile(true, _FRAME, axis=0) if len(true) else np.zeros((2, 3))
    side = 1.3 * max(float((high - low).max()), 1.0)
    shares = (points - (low + high) / 2) / side + 0.5
    inside = np.flatnonzero(((shares >= 0) & (shares < 1)).all(axis=1))
    inside = inside[:: max(1, -(-len(inside) // most))]
    return {
        "points": blobs.array((shares[inside] * 65535).astype(np.int64).ravel()),
        "codes": blobs.array(error_codes(errors[inside], limit)),
    }


def _photo(place: Place) -> str:
    """Return a photo from the middle of a scene, empty if it cannot be read."""
    try:
        path = list(place.photos.values())[len(place.photos) // 2]
        return data_uri(jpeg(read_rgb(path, long_side_px=_PHOTO_PX), 70), "image/jpeg")
    except (UserError, IndexError):
        return ""


@cache
def error_bar() -> str:
    """Return the scale of errors as a picture."""
    from PIL import Image

    stream = io.BytesIO()
    scale = np.append(np.linspace(0, 0.999, 240), np.ones(16))
    Image.fromarray(error_colours(scale, 1.0)[None]).save(stream, "PNG")
    return data_uri(stream.getvalue(), "image/png")
