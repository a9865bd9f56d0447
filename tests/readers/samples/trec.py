"""TREC runs, as trec_eval reads and ranx and Pyserini write them."""

from __future__ import annotations

from pathlib import Path

from tests.readers.retrieval_support import Place


def write(folder: Path, place: Place) -> Path:
    """Write the whole ranking of each query."""
    lines = []
    for scene in place.scenes:
        order, scores = place.ranked(scene)
        for query, tiles in enumerate(order.tolist()):
            for rank, tile in enumerate(tiles):
                score = float(scores[query, rank])
                named = f"{scene.query(query)} Q0 {scene.tile(tile)}"
                lines.append(f"{named} {rank + 1} {score!r} mine\n")
    path = folder / "mine.run"
    path.write_text("".join(lines))
    return path
