"""The matching track and its baseline, as the command line shows them."""

from __future__ import annotations

from dataclasses import dataclass

from airzoo_bench.evaluation.info import Baseline, TrackInfo


@dataclass(frozen=True)
class SiftSettings:
    """How the baseline matches photos with the map; see `geometry.sift` for features."""

    max_features: int = 8192
    max_map_features: int = 16384  # of a crop
    peak_threshold: float = 0.02 / 3  # pycolmap's own
    ratio: float = 0.8  # of the nearest to the second distance
    long_side_px: int = 2000
    doubled: bool = True


INFO = TrackInfo(
    name="matching",
    track="airzoo_bench.matching.track:TRACK",
    summary="Score cross-view matching: translation and pose recall, median error, for each scene.",
    argument="An .npz of matches, 2D-3D pairs or poses, or a .txt of poses.",
    kinds=".npz or .txt",
    suffixes=(".npz", ".txt"),
    figures="airzoo_bench.report.matching:draw_figures",
    baseline=Baseline(
        method="SIFT",
        summary="Match photos to their crops by SIFT, mutual neighbours and ratio test.",
        settings=SiftSettings(),
        demo=SiftSettings(doubled=False),
        out="sift-matches.npz",
        predict="airzoo_bench.matching.baseline:predict",
    ),
)
