"""What the page that compares two methods holds: differences, intervals and p of all pairs."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.site.page_views import UNITS, Json, number
from airzoo_bench.leaderboard.site.strangers import plain_name, shown
from airzoo_bench.report.packing import Blobs, page_json

__all__ = ["compare_data", "pair_files"]

_LIMITS, _P_VALUES = ("low", "high"), ("p", "p_holm")
# Shares are shown in percent with two digits; p has more, so that what is significant stays so.
_DIGITS = {"share": 4, "m": 2, "deg": 2, "p": 6}


def compare_data(table: Json, files: Mapping[str, Any]) -> tuple[str, list[str]]:
    """Return the data of the page, as its script reads them, and blobs of the pairs."""
    blobs = Blobs()
    found = pair_files(table, files)
    place = {row["id"]: number for number, row in enumerate(table["rows"])}
    rows = [table["rows"][at] for at in sorted(place[name] for name in found[0][1]["ids"])]
    times = Counter(shown(row["method"]) for row in rows)
    names = [_name(row, alone=times[shown(row["method"])] == 1) for row in rows]
    scenes = files.get(f"tables/{table['id']}/scenes.json", {}).get("scenes", {})
    data = {
        "methods": [
            {"id": row["id"], "name": name, "run": _run(table, row)}
            for row, name in zip(rows, names, strict=True)
        ],
        "scene": table["scenes"][0]["id"] if table["scenes"] else "",
        "scenes": [shown(scene["title"]) for scene in table["scenes"]],
        "scores": [
            _score(column, pairs, blobs)
            | {"scenes": _scene_values(column, table, rows, place, scenes)}
            for column, pairs in found
        ],
    }
    return page_json(data), blobs.texts


def _run(table: Json, row: Json) -> str | None:
    """Return where the data branch has what was scored; None of a result that is not of a run."""
    if row["rescored"] is None:
        return None
    return f"runs/{table['benchmark']}/{table['track']}/{plain_name(row['id'])}/{row['version']}"


def _name(row: Json, *, alone: bool) -> str:
    method = shown(row["method"])
    return method if alone or not row["team"] else f"{method} ({shown(row['team'])})"


def pair_files(table: Json, files: Mapping[str, Any]) -> list[tuple[Json, Json]]:
    """Return the scores of a table whose pairs there are, each with its file of pairs."""
    paths = [(c, c["pairs"].removeprefix("api/v1/")) for c in table["scores"] if c["pairs"]]
    return [(column, files[path]) for column, path in paths if path in files]


def _score(column: Json, pairs: Json, blobs: Blobs) -> dict[str, Any]:
    coded = {key: _coded(pairs[key], column["unit"], blobs) for key in _LIMITS}
    coded |= {key: _coded(pairs[key], "p", blobs) for key in _P_VALUES}
    return {
        "title": shown(column["title"]),
        "unit": UNITS[column["unit"]],
        "share": column["unit"] == "share",
        "higher": column["higher_is_better"],
        "values": [number(value) for value in pairs["values"]],
        "ids": list(pairs["ids"]),
        "family": pairs["family"],
        "about": shown(pairs["about"], 1000),
        **coded,
    }


def _coded(packed: str, unit: str, blobs: Blobs) -> dict[str, Any]:
    """Return numbers as codes into the list of the different ones."""
    values: Floats = np.frombuffer(base64.b64decode(packed), "<f4").astype(np.float64)
    different, codes = _different(np.round(values, _DIGITS[unit]) + 0.0, _DIGITS[unit])
    return {"values": different.tolist(), "codes": blobs.array(codes)}


def _different(values: Floats, digits: int) -> tuple[Floats, NDArray[np.intp]]:
    """Return different values, ascending, and codes into them; by counting where all are small."""
    if not (np.abs(values) <= 1).all():
        return np.unique(values, return_inverse=True)
    most = 10**digits
    steps = np.rint(values * most).astype(np.intp) + most
    found = np.zeros(2 * most + 1, np.bool_)
    found[steps] = True
    different = np.empty(len(found))
    different[steps] = values
    return different[found], (np.cumsum(found) - 1)[steps]


def _scene_values(
    column: Json, table: Json, rows: list[Json], place: Mapping[str, int], scenes: Json
) -> list[list[float | None]]:
    """Return a list a scene of the values of the methods."""
    return [
        [number(values[place[row["id"]]]) if values else None for row in rows]
        for scene in table["scenes"]
        for values in [scenes.get(scene["id"], {}).get(column["key"], {}).get("value")]
    ]
