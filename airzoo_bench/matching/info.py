"""The matching track and its baseline, as the command line shows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from airzoo_bench.core.registry import Option
from airzoo_bench.evaluation.info import DOUBLED, Baseline, EvalOption, TrackInfo


@dataclass(frozen=True)
class SiftSettings:
    """How the baseline matches photos with the map; see `geometry.sift` for features."""

    max_features: Annotated[int, Option("features", "Most SIFT features of a photo.", 4)] = 8192
    max_map_features: int = 16384  # of a crop
    peak_threshold: float = 0.02 / 3  # pycolmap's own
    ratio: float = 0.8  # of the nearest to the second distance
    long_side_px: Annotated[int, Option("long-side", "Largest side of a photo, px.", 64)] = 2000
    doubled: Annotated[bool, DOUBLED] = True


INFO = TrackInfo(
    name="matching",
    track="airzoo_bench.matching.track:TRACK",
    summary="Score cross-view matching: translation and pose recall, median error, for each scene.",
    argument="An .npz of matches, 2D-3D pairs or poses, or a .txt of poses.",
    example="matches.npz --out results/mymethod --figures",
    kinds=".npz or .txt",
    suffixes=(".npz", ".txt"),
    takes_image_size=True,
    options=(
        EvalOption(
            "figures",
            "Draw errors, matches and maps into --out; report and plot use them.",
            "airzoo_bench.report.matching:draw_figures",
        ),
    ),
    baseline=Baseline(
        method="SIFT",
        summary="Match photos to their crops by SIFT, mutual neighbours and ratio test.",
        settings=SiftSettings(),
        demo=SiftSettings(doubled=False),
        out="sift-matches.npz",
        out_help="The .npz to write.",
        example="brighton-matching --out matches.npz",
        predict="airzoo_bench.matching.baseline:predict",
    ),
)
