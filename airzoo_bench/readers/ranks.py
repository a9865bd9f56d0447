"""Lists of ranked tiles, such as runs of TREC, from methods without descriptors."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.files import first_bytes
from airzoo_bench.evaluation.predictions import (
    PredictionFile,
    QueryPredictions,
    Reader,
    ReadRequest,
)
from airzoo_bench.readers.descriptors import SceneImages, note_strange
from airzoo_bench.readers.names import ImageNames
from airzoo_bench.retrieval.predictions import RankedIds, RetrievalPredictions


class RankedLists(Reader):
    """Reads a score of some tiles for each query, the largest of the best."""

    track = "retrieval"
    conventions = ("the largest score is the first rank",)

    @abstractmethod
    def ranked(self, path: Path) -> Mapping[str, Mapping[str, float]]:
        """Read scores by query and tile, both by name; tiles best first, or in no order."""

    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        """See `Reader.read`."""
        images = SceneImages(request, str(path))
        given = self.ranked(path)
        several = [[*own.values()] for own in given.values() if len({*own.values()}) > 1]
        if several and all(one == sorted(one) for one in several):
            what = f"scores rise from each best tile to the last, as of {next(iter(given))[:200]!r}"
            raise PredictionError(what, where=path, fix="write distances with a minus sign")
        asked = images.queries.find_all(list(given), path)
        names = list(dict.fromkeys(tile for scores in given.values() for tile in scores))
        tiles = dict(zip(names, tile_ids(images.tiles, names, path), strict=True))
        lists, scores = {}, {}
        for query, own in zip(asked, given.values(), strict=True):
            if query is not None:
                best = sorted(own, key=own.__getitem__, reverse=True)
                lists[query] = [tiles[tile] for tile in best]
                scores[query] = [own[tile] for tile in best]
        predictions = ranked_lists(path, lists, scores)
        return PredictionFile(predictions, self.conventions, note_strange(len(asked) - len(lists)))


def tile_ids(known: ImageNames, names: Sequence[str], path: Path) -> list[str]:
    """Return the ids of tiles; refuse what is none."""
    found = known.find_all(names, path)
    strange = [name for name, one in zip(names, found, strict=True) if one is None]
    if strange:
        what = f"ranks what is no tile: {first_of([repr(name[:200]) for name in strange])}"
        fix = "rank the tiles of the benchmark's gallery alone, and run the method again"
        raise PredictionError(what, where=path, fix=fix)
    return [str(one) for one in found]


def ranked_lists(
    path: Path,
    lists: Mapping[str, Sequence[str]],
    scores: Mapping[str, Sequence[float]] | None = None,
) -> RetrievalPredictions:
    """Make predictions of ranked ids, best first, of any lengths."""
    if not lists:
        raise PredictionError("ranks no tile", where=path, expected="a list for each query")
    depth = max(map(len, lists.values()))
    letters = max((len(one) for ids in lists.values() for one in set(ids)), default=1)
    ids = np.full((len(lists), depth), "", f"<U{letters}")
    given = None if scores is None else np.zeros(ids.shape)
    for row, query in enumerate(lists):
        ids[row, : len(lists[query])] = lists[query]
        if given is not None and scores is not None:
            given[row, : len(lists[query])] = scores[query]
    return QueryPredictions(path, None, np.array(list(lists), dtype=str), RankedIds(ids, given))


class _Trec(RankedLists):
    """Runs as TREC has them: a line a ranked tile, ``query Q0 tile rank score tag``."""

    title = "a TREC run"
    layout = "text of six columns: query, Q0, tile, rank, score, tag"
    methods = ("trec_eval", "ranx", "ir_measures", "Pyserini")
    conventions = (
        "tiles are ranked by score, as trec_eval does; ranks in the file decide nothing",
    )

    def recognise(self, path: Path) -> float:
        lines = first_bytes(path, 1 << 14).decode("utf-8", "replace").split("\n")[:20]
        whole = [line.split() for line in lines[: max(1, len(lines) - 1)] if line.strip()]
        if not whole or any(_parse_rank(fields) is None for fields in whole):
            return 0.0
        return 0.95 if all(fields[1] == "Q0" for fields in whole) else 0.6

    def ranked(self, path: Path) -> Mapping[str, Mapping[str, float]]:
        run: dict[str, dict[str, tuple[int, float]]] = {}
        with path.open("rb") as stream:
            for number, line in enumerate(stream, 1):
                fields = line.decode("utf-8", "replace").split()
                parsed = _parse_rank(fields)
                if parsed is not None and fields[2] not in run.setdefault(fields[0], {}):
                    run[fields[0]][fields[2]] = parsed[0], -parsed[1]
                elif fields:
                    what = "is no line of a run, or has a tile a second time"
                    where = f"{path}, line {number:,}"
                    raise PredictionError(what, where=where, expected=self.layout)
        by_rank = {query: sorted(tiles.items(), key=itemgetter(1)) for query, tiles in run.items()}
        return {
            query: {tile: -score for tile, (_, score) in tiles} for query, tiles in by_rank.items()
        }


def _parse_rank(fields: list[str]) -> tuple[int, float] | None:
    """Return rank and score of a line; None where it is none of a run."""
    try:
        rank, score = (int(fields[3]), float(fields[4])) if len(fields) == 6 else (0, math.nan)
    except ValueError:
        return None
    return (rank, score) if math.isfinite(score) and abs(rank) < 1 << 60 else None


TREC = _Trec()
