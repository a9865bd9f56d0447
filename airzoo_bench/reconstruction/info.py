"""The reconstruction track and its baseline, as the command line shows them."""

from __future__ import annotations

from dataclasses import dataclass

from airzoo_bench.evaluation.info import Baseline, TrackInfo
from airzoo_bench.formats.archives import ARCHIVE_SUFFIXES
from airzoo_bench.formats.clouds import KINDS, SUFFIXES


@dataclass(frozen=True)
class SfmSettings:
    """How photos become a sparse model.

    A feature has at least the contrast `peak_threshold`, of grey values from 0 to 1. A match is
    kept where its distance is below `ratio` of the second nearest's; a pair needs `least_inliers`.
    Without `neighbours`, or without GPS, each photo is matched with all. `max_error_px` is the
    largest reprojection error, in pixels of the photo made small.
    """

    long_side_px: int = 1600
    max_features: int = 4096
    peak_threshold: float = 0.02 / 3
    doubled: bool = True
    ratio: float = 0.8
    neighbours: int | None = 12
    least_inliers: int = 15
    max_error_px: float = 4.0
    seed: int = 0


INFO = TrackInfo(
    name="reconstruction",
    track="airzoo_bench.reconstruction.track:TRACK",
    summary="Score multi-view reconstruction: Chamfer distance, F1, precision and recall, by "
    "scene.",
    argument="A folder or archive with an entry a scene (cloud, mesh, or .npz of depth or point "
    "maps), or one such file.",
    unit="scene",
    kinds=f"a folder, an archive, or {KINDS}",
    suffixes=(*SUFFIXES, *ARCHIVE_SUFFIXES),
    folders=True,
    fields=("depth", "world_points", "points"),
    figures="airzoo_bench.report.reconstruction:draw_figures",
    files={"alignment.json": "airzoo_bench.reconstruction.track:write_alignments"},
    baseline=Baseline(
        method="Structure from motion",
        summary="Reconstruct scenes by structure from motion (pycolmap): a sparse cloud and "
        "cameras.",
        settings=SfmSettings(),
        demo=SfmSettings(long_side_px=640, max_features=1500, neighbours=8),
        out="sfm",
        predict="airzoo_bench.reconstruction.baseline:predict",
    ),
)
