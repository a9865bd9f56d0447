"""Reads tables ``query,tile,similarity`` into predictions of the retrieval track."""

import csv
from collections import defaultdict
from pathlib import Path

from airzoo_bench.core.errors import readable
from airzoo_bench.core.files import first_bytes
from airzoo_bench.readers.ranks import RankedLists

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

    def ranked(self, path: Path) -> dict[str, dict[str, float]]:
        """Read similarities by query and tile, both by name."""
        found: dict[str, dict[str, float]] = defaultdict(dict)
        with readable(path, "is no table of ranks", expected=HEADER), path.open() as stream:
            for row in csv.DictReader(stream, restval=""):
                found[row["query"]][row["tile"]] = float(row["similarity"])
        return found


RANKS = RanksCsv()
