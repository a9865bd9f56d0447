"""What tries at a sealed AirZoo-Mini teach: ``python -m tests.leaderboard.attack FOLDER``.

Of a folder with its truth it prints the R@1 that who starts from tiles at random reaches, when a
try changes one tile in each scene and is kept if the score that is told rises.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.leaderboard.sealed_scoring import round_score
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth
from tests.statistics.support import HIT

TRIES = (0, 4, 48, 480)
"""None; a month and a year of the limit of `Limits`; ten accounts for a year."""
RUNS = 40

Hits = Sequence[NDArray[np.float64]]


def exact(hits: Hits) -> float:
    return float(np.mean([one.mean() for one in hits]))


def rounded(hits: Hits) -> float:
    return round_score(exact(hits), hits, HIT)[0]


def attacked(
    truths: Sequence[RetrievalTruth], telling: Callable[[Hits], float], tries: int, seed: int
) -> float:
    """Return the true R@1 after so many tries, from tiles at random."""
    random = np.random.default_rng(seed)
    guesses = [random.integers(len(of.tiles), size=len(of.queries)) for of in truths]

    def hits_of(guess: Sequence[NDArray[np.int64]]) -> Hits:
        return [
            of.positives.holds(np.arange(len(of.queries)), one, len(of.tiles)).astype(float)
            for of, one in zip(truths, guess, strict=True)
        ]

    best = telling(hits_of(guesses))
    for _ in range(tries):
        others = [guess.copy() for guess in guesses]
        for of, guess in zip(truths, others, strict=True):
            guess[random.integers(len(guess))] = random.integers(len(of.tiles))
        score = telling(hits_of(others))
        if score > best:
            guesses, best = others, score
    return exact(hits_of(guesses))


def main() -> None:
    scenes = sorted((Path(sys.argv[1]) / "scenes").iterdir())
    truths = [read_truth(path, path.name) for path in scenes]
    print(f"{'tries':16}" + "".join(f"{tries:>8}" for tries in TRIES))  # noqa: T201
    for name, telling in (("exact scores", exact), ("as they are told", rounded)):
        found = [
            np.mean([attacked(truths, telling, tries, seed) for seed in range(RUNS)])
            for tries in TRIES
        ]
        print(f"{name:16}" + "".join(f"{value:8.1%}" for value in found))  # noqa: T201


if __name__ == "__main__":
    main()
