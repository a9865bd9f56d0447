"""Retrieval by colour: histograms of photos and tiles, compared by the protocol's metric.

python examples/retrieval_colours.py airzoo-mini airzoo-mini-retrieval colours.npz
airzoo-bench eval retrieval colours.npz
"""

import sys

import numpy as np

import airzoo_bench as ab

BINS = 8
SIDE_PX = 512


def describe(image: np.ndarray) -> np.ndarray:
    """Return the square root of an image's histogram of colours: unit length, (BINS ** 3,)."""
    red, green, blue = (image // (256 // BINS)).reshape(-1, 3).astype(int).T
    counts = np.bincount((red * BINS + green) * BINS + blue, minlength=BINS**3)
    return np.sqrt(counts / counts.sum())


def main(benchmark: str, protocol: str, out: str) -> None:
    """Describe every photo and every tile."""
    opened = ab.load_benchmark(benchmark)
    with ab.PredictionWriter(out, protocol, opened) as writer:
        for scene in opened.scenes:
            tiles, queries = scene.tiles(), scene.queries()
            print(f"{scene.id}: {len(tiles)} tiles, {len(queries)} queries")  # noqa: T201
            for tile in tiles:
                writer.add(tile.id, descriptor=describe(tile.image))
            for query in queries:
                writer.add(query.id, descriptor=describe(query.read(SIDE_PX)))
    print(f"wrote {out}")  # noqa: T201


if __name__ == "__main__":
    main(*sys.argv[1:])
