"""What tries at a sealed AirZoo-Mini teach.

``python -m tests.leaderboard.sealed.attack FOLDER`` prints, of a folder with its truth, two tables:

- the R@1 that who starts from tiles at random reaches, when a try changes one tile in each scene
  and is kept if the score that is told rises;
- how often who has half of the answers right, at the worst edge between two steps, tells rightly
  whether a query is among them, by spoiling that one; a guess is right in 50 %.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.leaderboard.sealed.rounding import Spread, drawn, told
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth

R1 = ScoreColumn(
    key="recall@1", title="R@1", unit="share", higher_is_better=True, average="mean", headline=True
)
TRIES = (4, 48, 480)
"""A month and a year of the limit of `Limits`, and ten accounts for a year."""
RUNS = 40

Hits = NDArray[np.float64]
Telling = Callable[[Hits, str], float]


def exact(hits: Hits, salt: str) -> float:
    """Tell the score."""
    return float(hits.mean())


def nearest(hits: Hits, salt: str) -> float:
    """Tell the nearest step."""
    return told(Spread.of(hits, R1)).value or 0.0


def sealed(hits: Hits, salt: str) -> float:
    """Tell what a submitter is told."""
    return told(Spread.of(hits, R1, drawn(salt, "scene", hits))).value or 0.0


WAYS = {"exact scores": exact, "to the nearest step": nearest, "as they are told": sealed}


def attacked(truth: RetrievalTruth, telling: Telling, tries: int, seed: int) -> float:
    """Return the true R@1 after so many tries at one scene, from tiles at random."""
    random = np.random.default_rng(seed)
    salt, count, tiles = f"{seed:064x}", len(truth.queries), len(truth.tiles)
    guess = random.integers(tiles, size=count)
    queries = np.arange(count)
    hits = truth.positives.holds(queries, guess, tiles).astype(float)
    best = telling(hits, salt)
    for _ in range(tries):
        query, tile = random.integers(count), random.integers(tiles)
        other = hits.copy()
        other[query] = truth.positives.holds(np.array([query]), np.array([tile]), tiles)[0]
        score = telling(other, salt)
        if score > best:
            hits, best = other, score
    return float(hits.mean())


def reached(truths: list[RetrievalTruth], telling: Telling, tries: int, runs: int = RUNS) -> float:
    """Return the mean over scenes and runs."""
    found = [attacked(of, telling, tries, seed) for of in truths for seed in range(runs)]
    return float(np.mean(found))


def told_apart(truth: RetrievalTruth, telling: Telling, runs: int = 400) -> float:
    """Return how often a query's answer is told right by one try, at the worst place there is."""
    count = len(truth.queries)
    best = 0.0
    for right in range(count // 2 - 4, count // 2 + 4):
        hits = (np.arange(count) < right).astype(float)
        shares = []
        for was_hit in (True, False):
            fell = 0
            for seed in range(runs):
                salt, place = f"{seed:064x}", seed % right if was_hit else right
                spoilt = hits.copy()
                spoilt[place] = 0.0
                # Another tile is wrong otherwise: a new draw, if nothing else.
                fell += telling(spoilt, salt) < telling(hits, salt)
            shares.append(fell / runs)
        best = max(best, 0.5 + abs(shares[0] - shares[1]) / 2)
    return best


def main() -> None:
    folder = Path(sys.argv[1])
    truths = [read_truth(path, path.name) for path in sorted((folder / "scenes").iterdir())]
    print(f"{'tries':24}" + "".join(f"{tries:>8}" for tries in (0, *TRIES)))  # noqa: T201
    for name, telling in WAYS.items():
        found = [reached(truths, telling, tries) for tries in (0, *TRIES)]
        print(f"{name:24}" + "".join(f"{value:8.1%}" for value in found))  # noqa: T201
    print(f"{'one query told right':24}{'':8}{'':8}")  # noqa: T201
    for name, telling in WAYS.items():
        found = [told_apart(of, telling) for of in truths]
        print(f"{name:24}{max(found):16.0%}")  # noqa: T201


if __name__ == "__main__":
    main()
