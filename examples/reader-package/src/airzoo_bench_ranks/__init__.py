"""Reads tables ``query,tile,similarity`` into predictions of the retrieval track."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import read_text
from airzoo_bench.evaluation.queries import QueryPredictions
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions
from airzoo_bench.readers.names import ImageNames, names_in
from airzoo_bench.retrieval.predictions import RankedIds

__all__ = ["RANKS"]

HEADER = "query,tile,similarity"


class RanksCsv(Reader):
    """See `Reader`."""

    track = "retrieval"
    title = "ranks.csv of my method"
    layout = f"a CSV file that begins with {HEADER}"
    methods = ("my method",)

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        if not path.is_file():
            return 0.0
        with path.open("rb") as stream:
            return 0.9 if stream.read(len(HEADER)) == HEADER.encode() else 0.0

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        text = read_text(path, PredictionError, "table of ranks", reading.memory_bytes // 16)
        found: dict[str, list[tuple[float, str]]] = {}
        for number, row in enumerate(csv.DictReader(io.StringIO(text)), start=2):
            try:
                found.setdefault(row["query"], []).append((-float(row["similarity"]), row["tile"]))
            except (KeyError, TypeError, ValueError) as error:
                where = f"{path}, line {number}"
                raise PredictionError("is no row", where=where, expected=HEADER) from error
        if not found:
            raise PredictionError("has no row", where=path, expected=HEADER)
        photos = ImageNames.of(
            "query",
            names_in(truth.queries for truth in reading.truths),
            left_out=names_in(truth.excluded for truth in reading.truths),
            scenes=reading.scenes,
        )
        ids = photos.find_all(list(found), path)
        lists = [sorted(rows) for one, rows in zip(ids, found.values(), strict=True) if one]
        depth = max(map(len, lists))
        tiles = [[tile for _, tile in rows] + [""] * (depth - len(rows)) for rows in lists]
        scores = [[-value for value, _ in rows] + [0.0] * (depth - len(rows)) for rows in lists]
        ranked = RankedIds(np.array(tiles), np.array(scores))
        predictions = QueryPredictions(path, None, np.array([one for one in ids if one]), ranked)
        return ReadPredictions(predictions, ("the largest similarity is the first rank",))


RANKS = RanksCsv()
