"""Print what tries at a sealed truth teach: python -m tests.leaderboard.attack FOLDER."""

import sys
from pathlib import Path

import numpy as np

from airzoo_bench.leaderboard.sealing import round_score
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth
from tests.statistics.support import HIT


def attack(truths: list[RetrievalTruth], seed: int, *, rounded: bool) -> list[float]:
    """Return the true R@1 of tiles at random, and after tries that change a tile in each scene."""
    random, best, reached = np.random.default_rng(seed), -1.0, [0.0]
    kept = tried = [random.integers(len(of.tiles), size=len(of.queries)) for of in truths]
    for _ in range(481):
        both = [*zip(truths, tried, strict=True)]
        found = [of.positives.holds(np.arange(len(t)), t, len(of.tiles)) for of, t in both]
        true = float(np.mean([hits.mean() for hits in found]))
        told = round_score(true, [hits * 1.0 for hits in found], HIT)[0] if rounded else true
        reached.append(true if told > best else reached[-1])
        kept, best = (tried, told) if told > best else (kept, best)
        tried = [tiles.copy() for tiles in kept]
        for of, tiles in zip(truths, tried, strict=True):
            tiles[random.integers(len(tiles))] = random.integers(len(of.tiles))
    return reached[1:]


if __name__ == "__main__":
    given = [read_truth(path, path.name) for path in sorted(Path(sys.argv[1], "scenes").iterdir())]
    for rounded in (False, True):
        means = np.mean([attack(given, seed, rounded=rounded) for seed in range(40)], axis=0)
        for tries in (0, 4, 48, 480):
            print(f"{tries} tries, rounded {rounded}: {means[tries]:.1%}")  # noqa: T201
