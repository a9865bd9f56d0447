"""What tries at a sealed AirZoo-Mini teach: ``python -m tests.leaderboard.attack FOLDER``.

Of a folder with its truth it prints the R@1 that who starts from tiles at random reaches, when a
try changes one tile in each scene and is kept if the score that is told rises. 480 tries are those
of ten accounts for a year.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.leaderboard.sealing import round_score
from airzoo_bench.retrieval.truth import read_truth
from tests.statistics.support import HIT


def attack(truths: list[Any], tries: int, seed: int, *, rounded: bool) -> float:
    """Return the true R@1 after so many tries, from tiles at random."""
    random = np.random.default_rng(seed)
    guesses = [random.integers(len(of.tiles), size=len(of.queries)) for of in truths]
    best, kept = -1.0, 0.0
    for number in range(tries + 1):
        others, hits = [guess.copy() for guess in guesses], []
        for of, guess in zip(truths, others, strict=True):
            if number:
                guess[random.integers(len(guess))] = random.integers(len(of.tiles))
            found = of.positives.holds(np.arange(len(guess)), guess, len(of.tiles))
            hits.append(found.astype(float))
        true = float(np.mean([one.mean() for one in hits]))
        told = round_score(true, hits, HIT)[0] if rounded else true
        if told > best:
            guesses, best, kept = others, told, true
    return kept


if __name__ == "__main__":
    found = [read_truth(path, path.name) for path in sorted(Path(sys.argv[1], "scenes").iterdir())]
    for tries in (0, 4, 48, 480):
        for rounded in (False, True):
            shares = [attack(found, tries, seed, rounded=rounded) for seed in range(40)]
            print(f"{tries} tries, rounded {rounded}: {np.mean(shares):.1%}")  # noqa: T201
