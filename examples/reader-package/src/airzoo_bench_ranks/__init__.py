"""Reads tables ``query,tile,similarity`` into predictions of the retrieval track."""

import csv
from pathlib import Path

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import first_bytes
from airzoo_bench.formats.budget import Budget
from airzoo_bench.readers.ranks import RankedLists, RankedTiles

HEADER = "query,tile,similarity"


class RanksCsv(RankedLists):
    """A line a ranked tile, in any order."""

    title = "ranks.csv of my method"
    layout = f"a CSV file that begins with {HEADER}"
    methods = ("my method",)
    conventions = ("the largest similarity is the first rank",)

    def recognise(self, path: Path) -> float:
        """Return how sure it is that a path is of my method."""
        return 0.9 * (first_bytes(path, len(HEADER)) == HEADER.encode())

    def ranked(self, path: Path, budget: Budget) -> RankedTiles:
        """Read names of queries and tiles, with similarities."""
        found = RankedTiles()
        with path.open(encoding="utf-8", newline="") as stream:
            for number, row in enumerate(csv.DictReader(stream), start=2):
                try:
                    found.add(row["query"], row["tile"], float(row["similarity"]))
                except (KeyError, TypeError, ValueError) as error:
                    where = f"{path}, line {number}"
                    raise PredictionError("is no row", where=where, expected=HEADER) from error
        return found


RANKS = RanksCsv()
