"""Answers that a `PredictionWriter` refuses at once: alone, or after those before."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.api.benchmark import BlindBenchmark
from airzoo_bench.api.prediction_writer import PredictionWriter
from airzoo_bench.core.errors import UserError
from tests.api.place import MATCHING, NAME, RECONSTRUCTION, RETRIEVAL, TILES, A, B

XY = np.array([[10.0, 20.0], [30.0, 40.0]])
TURN = np.diag((1.0, -1.0, -1.0))
CENTRE = np.array((500_100.0, 5_199_900.0, 190.0))
K = np.array([[32.0, 0, 16], [0, 32.0, 12], [0, 0, 1]])
VIEW = {"rotation": TURN, "centre": CENTRE, "intrinsics": K, "depth": np.ones((24, 32))}


@pytest.mark.parametrize(
    ("protocol", "name", "fields", "message"),
    [
        (RETRIEVAL, f"{NAME}/aa", {"ranked_ids": TILES}, "is no query of the benchmark.*did you"),
        (RETRIEVAL, f"{A}.PNG", {"ranked_ids": TILES}, "(?s)is no query.*fix: +'field/a'$"),
        (RETRIEVAL, "a", {"ranked_ids": TILES}, "(?s)is no query.*fix: +'field/a'$"),
        (RETRIEVAL, "c.png", {"ranked_ids": TILES}, "(?s)is no query.*fix: +'field/sub/c'$"),
        (RETRIEVAL, A, {"ranked_ids": [f"{TILES[0]}.png"]}, "(?s)is no tile.*fix: +'field/160_0"),
        (RETRIEVAL, A, {"ranks": TILES}, "(?s)ranks is no answer.*ranked_ids and perhaps scores"),
        (RETRIEVAL, A, {"ranked_ids": TILES, "colour": None}, "ranked_ids and colour is no answer"),
        (RETRIEVAL, A, {"ranked_ids": [*TILES, "field/9"]}, "'field/9' is no tile of the gallery"),
        (RETRIEVAL, A, {"ranked_ids": [TILES[0], TILES[0]]}, "ranked more than once"),
        (RETRIEVAL, A, {"ranked_ids": TILES, "scores": [1, 2]}, r"scores: has shape \(2,\)"),
        (RETRIEVAL, A, {"ranked_ids": TILES[:3], "scores": [1, 3, 2]}, "not in order"),
        (RETRIEVAL, A, {"ranked_ids": TILES[:2], "scores": [1, np.nan]}, "NaN or infinite"),
        (RETRIEVAL, A, {"scores": [1.0]}, "scores is no answer of the retrieval track"),
        (RETRIEVAL, A, {"ranked_ids": TILES, "descriptor": [1.0]}, "is no answer"),
        (RETRIEVAL, A, {"map_xy": XY}, "is no answer of the retrieval track"),
        (RETRIEVAL, A, {}, "nothing is no answer"),
        (RETRIEVAL, TILES[0], {"descriptor": np.ones((2, 2))}, r"float64 of shape \(2, 2\)"),
        (RETRIEVAL, TILES[0], {"descriptor": [1, 2]}, "descriptor is int64"),
        (RETRIEVAL, A, {"descriptor": np.ma.masked_equal([1.0, 2], 2)}, "has masked entries"),
        (RETRIEVAL, A, {"descriptor": {1.0: 2}}, "descriptor: is a dict"),
        (
            RETRIEVAL,
            A,
            {"ranked_ids": pd.Series(TILES[:2]), "scores": pd.Series([2, 1], [1, 0])},
            "ranked_ids, scores: have different indexes",
        ),
        (
            MATCHING,
            A,
            {"query_xy": pd.DataFrame(XY), "map_xy": pd.DataFrame(XY, [1, 0])},
            "query_xy, map_xy: have different indexes",
        ),
        (RETRIEVAL, A, {"descriptor": [1.0, np.inf]}, "NaN or infinite descriptors"),
        (RETRIEVAL, "elsewhere/a", {"descriptor": [1.0]}, "no query or tile of the benchmark"),
        (MATCHING, f"{NAME}/x", {"query_xy": XY, "map_xy": XY}, "is no query"),
        (MATCHING, A, {"query_xy": XY, "map_xy": XY[:1]}, "map_xy has 1 rows, query_xy has 2"),
        (MATCHING, A, {"query_xy": XY[0], "map_xy": XY}, r"shape \(2,\)(.|\n)*shape \(N, 2\)"),
        (MATCHING, A, {"query_xy": XY * 20, "map_xy": XY}, "2 of 2 pixels.*outside the photo"),
        (
            MATCHING,
            A,
            {"query_xy": XY, "map_xy": XY * np.nan},
            "map_xy: holds NaN or infinity in 2 of 2 rows",
        ),
        (MATCHING, A, {"query_xy": XY}, "query_xy is no answer of the matching track"),
        (MATCHING, A, {"rotation": TURN * 2, "centre": CENTRE}, "rotat"),
        (MATCHING, A, {"rotation": TURN, "centre": CENTRE.astype("f4")}, "centre: is float32"),
        (RECONSTRUCTION, A, {"points": XY}, "is no scene of the benchmark"),
        (RECONSTRUCTION, NAME, {"points": XY}, r"points: has shape \(2, 2\)"),
        (RECONSTRUCTION, NAME, {"points": np.zeros((0, 3))}, "points is empty"),
        (RECONSTRUCTION, NAME, {"points": np.full((3, 3), np.nan)}, "points: holds NaN"),
        (RECONSTRUCTION, f"{NAME}/x", VIEW, "is no photo of the reconstruction"),
        (
            RECONSTRUCTION,
            A,
            VIEW | {"depth": np.ones((240, 320))},
            "look of images of about 32 x 24",
        ),
        (
            RECONSTRUCTION,
            A,
            VIEW | {"depth": np.ones((12, 16))},
            "look of images of about 32 x 24",
        ),
        (RECONSTRUCTION, A, VIEW | {"depth": np.ones((2, 24, 32))}, "with 2 axes"),
        (RECONSTRUCTION, A, VIEW | {"confidence": np.ones((2, 2))}, "confidence has shape"),
        (RECONSTRUCTION, A, {"depth": VIEW["depth"]}, "depth is no answer"),
    ],
)
def test_what_cannot_be_scored_is_refused_at_once(
    root: Path,
    field: BlindBenchmark,
    tmp_path: Path,
    protocol: str,
    name: str,
    fields: dict[str, Any],
    message: str,
) -> None:
    out = tmp_path / ("mine" if protocol == RECONSTRUCTION else "mine.npz")
    writer = PredictionWriter(out, protocol, field)
    with pytest.raises(UserError, match=message) as refusal:
        writer.add(name, **fields)
    assert str(refusal.value).startswith(f"{out}, {name}")
    assert len(writer) == 0


Add = Callable[[PredictionWriter], None]


@pytest.mark.parametrize(
    ("protocol", "first", "second", "message"),
    [
        (
            RETRIEVAL,
            lambda w: w.add(A, ranked_ids=TILES),
            lambda w: w.add(A, ranked_ids=TILES),
            "was added before",
        ),
        (
            RETRIEVAL,
            lambda w: w.add(A, ranked_ids=TILES),
            lambda w: w.add(B, descriptor=[1.0]),
            "descriptor after answers of another kind",
        ),
        (
            RETRIEVAL,
            lambda w: w.add(A, ranked_ids=TILES[:2], scores=[2, 1]),
            lambda w: w.add(B, ranked_ids=TILES[:2], scores=[1, 2]),
            "scores rise here and fall",
        ),
        (
            RETRIEVAL,
            lambda w: w.add(A, ranked_ids=TILES),
            lambda w: w.add(B, ranked_ids=TILES[:2], scores=[1, 2]),
            "scores with some queries only",
        ),
        (
            RETRIEVAL,
            lambda w: w.add(A, descriptor=[1.0, 2.0]),
            lambda w: w.add(TILES[0], descriptor=[1.0]),
            r"\(1,\)(.|\n)*\(2,\), the shape of the first",
        ),
        (
            RECONSTRUCTION,
            lambda w: w.add(A, **VIEW),
            lambda w: w.add(NAME, points=np.ones((3, 3))),
            "a cloud and depth maps",
        ),
        (
            RECONSTRUCTION,
            lambda w: w.add(NAME, points=np.ones((3, 3))),
            lambda w: w.add(A, **VIEW),
            "a cloud and depth maps",
        ),
        (
            RECONSTRUCTION,
            lambda w: w.add(A, **VIEW),
            lambda w: w.add(B, **VIEW | {"depth": np.ones((25, 32))}),
            "the shape of the first",
        ),
        (
            RECONSTRUCTION,
            lambda w: w.add(A, **VIEW),
            lambda w: w.add(B, rotation=TURN, centre=CENTRE),
            "has no depth",
        ),
        (
            RECONSTRUCTION,
            lambda w: w.add(A, **VIEW),
            lambda w: w.add(B, **VIEW, confidence=np.ones((24, 32))),
            "confidence with some photos only",
        ),
    ],
)
def test_answers_that_do_not_go_together(
    root: Path,
    field: BlindBenchmark,
    tmp_path: Path,
    protocol: str,
    first: Add,
    second: Add,
    message: str,
) -> None:
    writer = PredictionWriter(tmp_path / "mine.npz", protocol, field)
    first(writer)
    with pytest.raises(UserError, match=message):
        second(writer)
    assert len(writer) == 1
