"""The matching track, as the command line shows it."""

from __future__ import annotations

from airzoo_bench.evaluation.info import EvalOption, TrackInfo
from airzoo_bench.matching.baseline_settings import SIFT

__all__ = ["INFO"]

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
            "Draw error curves, matches and maps into --out.",
            "airzoo_bench.report.matching:draw_figures",
            files=r"errors\.png|.+_(map|matches)\.png",
        ),
    ),
    files={"timings.csv": "airzoo_bench.matching.track:write_timings"},
    baseline=SIFT,
)
