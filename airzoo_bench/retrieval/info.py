"""The retrieval track and its baseline, as the command line shows them."""

from __future__ import annotations

from dataclasses import dataclass

from airzoo_bench.evaluation.info import Baseline, TrackInfo


@dataclass(frozen=True)
class VladSettings:
    """How the baseline describes images."""

    max_features: int = 2048  # the strongest of an image are kept
    doubled: bool = True
    long_side_px: int = 1024


INFO = TrackInfo(
    name="retrieval",
    track="airzoo_bench.retrieval.track:TRACK",
    summary="Score aerial image retrieval: Recall@K, AP@5 and more, for each scene.",
    argument="An .npz or .parquet prediction file.",
    kinds=".npz or .parquet",
    suffixes=(".npz", ".parquet"),
    fields=("ranked_ids", "query_descriptors"),
    jobs=1,
    baseline=Baseline(
        method="SIFT and VLAD",
        summary="Describe photos and tiles by SIFT and VLAD, and write a prediction file.",
        settings=VladSettings(),
        demo=VladSettings(doubled=False),
        out="sift-vlad.npz",
        predict="airzoo_bench.retrieval.baseline:predict",
    ),
    templates=("ranked-ids", "descriptors"),
)
