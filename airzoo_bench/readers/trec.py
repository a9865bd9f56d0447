"""Runs as TREC has them: a line a ranked tile, ``query Q0 tile rank score tag``."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.files import first_bytes
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions
from airzoo_bench.formats.budget import Budget
from airzoo_bench.readers.retrieval import SceneImages, aside, ranked_lists

__all__ = ["TREC", "TrecReader"]

_FIELDS = 6
_TRIED_BYTES = 1 << 14
_TRIED_LINES = 20
_LONGEST_LINE = 1 << 12
_LINES_COUNTED = 1024
_BYTES_OF_LINE, _BYTES_OF_NAME = 48, 400  # of memory
_EXPECTED = "lines of six fields: query, Q0, tile, rank, score, name of the run"


class TrecReader(Reader):
    """See `Reader`."""

    track = "retrieval"
    title = "a TREC run"
    layout = "text of six columns: query, Q0, tile, rank, score, tag"
    methods = ("trec_eval", "ranx", "ir_measures", "Pyserini")

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        head = first_bytes(path, _TRIED_BYTES)
        lines = head.decode("utf-8", "replace").split("\n")[:_TRIED_LINES]
        whole = [line.split() for line in lines[: max(1, len(lines) - 1)] if line.strip()]
        if not whole or any(_parsed(fields) is None for fields in whole):
            return 0.0
        return 0.95 if all(fields[1] == "Q0" for fields in whole) else 0.6

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """See `Reader.read`."""
        images = SceneImages.of(reading, path)
        budget = Budget(reading.memory_bytes)
        run = _read_run(path, budget)
        asked = images.queries.find_all(list(run.lists), path)
        tiles = images.tiles.find_all(list(run.tiles), path)
        strange = [name for name, one in zip(run.tiles, tiles, strict=True) if one is None]
        if strange:
            raise PredictionError(
                f"ranks what is no tile: {first_of([repr(name) for name in strange])}",
                where=path,
                expected="tiles of the benchmark's gallery",
                fix="rank the tiles of tiles.parquet",
            )
        lists, scores = {}, {}
        for query, found in zip(asked, run.lists.values(), strict=True):
            if query is not None:
                order = found.by_score()
                lists[query] = [str(tiles[found.tiles[place]]) for place in order]
                scores[query] = [found.scores[place] for place in order]
        predictions = ranked_lists(path, lists, scores, budget)
        said = "tiles are ranked by score, as trec_eval does; ranks in the file decide nothing"
        return ReadPredictions(predictions, (said,), aside(len(asked) - len(lists)))


TREC = TrecReader()


@dataclass(frozen=True)
class _List:
    """What a run says of one query, in the order of its lines."""

    tiles: array[int] = field(default_factory=lambda: array("l"))
    ranks: array[int] = field(default_factory=lambda: array("q"))
    scores: array[float] = field(default_factory=lambda: array("d"))

    def by_score(self) -> list[int]:
        """Return places, largest score first."""
        return sorted(range(len(self.scores)), key=lambda place: -self.scores[place])

    def rises(self) -> bool:
        """Whether scores rise with the rank, as distances do."""
        if len(set(self.ranks)) < len(self.ranks):
            return False
        order = sorted(range(len(self.ranks)), key=lambda place: self.ranks[place])
        return any(self.scores[after] > self.scores[before] for before, after in pairwise(order))


@dataclass(frozen=True)
class _Run:
    """The lists by query, and the numbers of the tiles."""

    lists: dict[str, _List] = field(default_factory=dict)
    tiles: dict[str, int] = field(default_factory=dict)


def _read_run(path: Path, budget: Budget) -> _Run:
    run = _Run()
    with path.open("rb") as stream:
        for number, line in enumerate(iter(lambda: stream.readline(_LONGEST_LINE), b""), 1):
            fields = line.decode("utf-8", "replace").split()
            if not fields:
                continue
            parsed = _parsed(fields)
            if parsed is None or len(line) == _LONGEST_LINE:
                raise _no_line(path, number)
            if number % _LINES_COUNTED == 1:
                held = (number + _LINES_COUNTED) * _BYTES_OF_LINE + len(run.tiles) * _BYTES_OF_NAME
                budget.hold(path, "its lines", held)
            one = run.lists.setdefault(fields[0], _List())
            one.tiles.append(run.tiles.setdefault(fields[2], len(run.tiles)))
            one.ranks.append(parsed[0])
            one.scores.append(parsed[1])
    _check_order(path, run)
    return run


def _check_order(path: Path, run: _Run) -> None:
    rising = [query for query, one in run.lists.items() if one.rises()]
    if rising:
        raise PredictionError(
            f"scores rise with the rank for {first_of(map(repr, rising), len(run.lists))}",
            where=path,
            expected="similarities: the first rank has the largest score",
            fix="write distances with a minus sign",
        )


def _parsed(fields: list[str]) -> tuple[int, float] | None:
    """Return rank and score of a line; None where it is none of a run."""
    if len(fields) != _FIELDS or not fields[3].lstrip("-").isdecimal() or len(fields[3]) > 18:
        return None
    try:
        score = float(fields[4])
        rank = int(fields[3])
    except ValueError:
        return None
    return (rank, score) if math.isfinite(score) else None


def _no_line(path: Path, number: int) -> PredictionError:
    return PredictionError(
        "is no line of a run",
        where=f"{path}, line {number:,}",
        expected=_EXPECTED + "; scores are finite numbers",
        fix="write the run again",
    )
