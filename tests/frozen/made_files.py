"""Files that sessions are fed with: a made-up place, and predictions edited into mistakes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.cli.bad_prediction_cases import CASES
from tests.cli.bad_predictions import prediction_file
from tests.support import (
    NORTH_WEST,
    PLACE_CRS,
    MadeScene,
    made_protocol,
    make_place,
    write_benchmark,
)

_SCENES = [
    MadeScene("east", [[q, q + 1] for q in range(6)], 12),
    MadeScene("west", [[q, q + 1] for q in range(4)], 8),
]


def make(what: str, *rest: str) -> None:
    """Do what a line ``$ make ...`` of a session says.

    place                      the sources of `prepare photos`
    benchmark                  a benchmark folder, and predictions that are perfect
    mistakes                   the files of tests/cli/test_bad_predictions
    text PATH CONTENT          a text
    npz NEW OLD FIELD=CODE ... a copy with fields changed (``a`` is the old array) or left out
    """
    makers = {"place": _place, "benchmark": _benchmark, "mistakes": _mistakes}
    {**makers, "npz": _npz, "text": _text}[what](*rest)


def _place() -> None:
    from pyproj import Transformer

    place = make_place(Path())
    to_degrees = Transformer.from_crs(PLACE_CRS, "EPSG:4326", always_xy=True)
    rows = ["image,lon,lat,altitude_m,yaw_deg,pitch_deg,roll_deg"]
    for name, (x, y) in place.centres.items():
        lon, lat = to_degrees.transform(NORTH_WEST[0] + x + 3, NORTH_WEST[1] - y)
        rows.append(f"{name},{lon:.8f},{lat:.8f},201,0.5,-90,0")
    Path("priors.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")


def _benchmark() -> None:
    write_benchmark(Path("data/made"), made_protocol(_SCENES), _SCENES)
    np.savez("perfect.npz", protocol="made-retrieval", **_perfect())


def _perfect() -> dict[str, Any]:
    ids, ranked = [], []
    for scene in _SCENES:
        for number, found in enumerate(scene.positives):
            rest = [t for t in range(scene.n_tiles) if t not in found]
            ids.append(scene.query(number))
            ranked.append([scene.tile(t) for t in [*found, *rest][:8]])
    return {"query_ids": ids, "ranked_ids": ranked}


def _mistakes() -> None:
    gallery = [tile for scene in _SCENES for tile in scene.tile_ids]
    for name, (write, _) in CASES.items():
        folder = Path("bad", slug(name))
        folder.mkdir(parents=True)
        prediction_file(folder, write, _perfect() | {"gallery_ids": gallery})


def slug(case: str) -> str:
    """Return the name of a case as that of a folder."""
    return "-".join("".join(c if c.isalnum() else " " for c in case).split())


def _npz(new: str, old: str, *changes: str) -> None:
    with np.load(old) as file:
        arrays = dict(file)
    for change in changes:
        field, _, expression = change.partition("=")
        a = arrays.pop(field, None)
        if expression:
            arrays[field] = np.array(eval(expression, {"np": np, "a": a, **arrays}))
    Path(new).parent.mkdir(parents=True, exist_ok=True)
    np.savez(new, **arrays)


def _text(path: str, content: str) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(content.encode().decode("unicode_escape"), encoding="utf-8")
