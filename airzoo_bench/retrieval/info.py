"""The retrieval track, as the command line shows it."""

from __future__ import annotations

from airzoo_bench.evaluation.info import TrackInfo
from airzoo_bench.retrieval.baseline_settings import VLAD

__all__ = ["INFO"]

INFO = TrackInfo(
    name="retrieval",
    track="airzoo_bench.retrieval.track:TRACK",
    summary="Score aerial image retrieval: Recall@K, AP@5 and more, for each scene.",
    argument="An .npz or .parquet prediction file.",
    kinds=".npz or .parquet",
    suffixes=(".npz", ".parquet"),
    jobs=1,
    baseline=VLAD,
    templates=("ranked-ids", "descriptors"),
)
