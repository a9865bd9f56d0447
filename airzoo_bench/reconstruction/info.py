"""The reconstruction track, as the command line shows it."""

from __future__ import annotations

from airzoo_bench.evaluation.info import EvalOption, TrackInfo
from airzoo_bench.formats.archives import ARCHIVE_SUFFIXES
from airzoo_bench.formats.clouds.suffixes import KINDS, SUFFIXES
from airzoo_bench.reconstruction.baseline_settings import STRUCTURE_FROM_MOTION

__all__ = ["INFO"]

INFO = TrackInfo(
    name="reconstruction",
    track="airzoo_bench.reconstruction.track:TRACK",
    summary="Score multi-view reconstruction: Chamfer distance, F1, precision and recall, by "
    "scene.",
    argument="A folder or archive with an entry a scene (cloud, mesh, or .npz of depth or point "
    "maps), or one such file.",
    example="clouds --out results/mymethod --figures",
    unit="scene",
    kinds=f"a folder, an archive, or {KINDS}",
    suffixes=(*SUFFIXES, *ARCHIVE_SUFFIXES),
    folders=True,
    fields=("depth", "world_points", "points"),
    options=(
        EvalOption(
            "figures",
            "Draw curves and maps of errors into --out.",
            "airzoo_bench.report.reconstruction:draw_figures",
            files=r".+_(curve|precision|recall)\.png",
        ),
        EvalOption(
            "clouds",
            "Write clouds coloured by their errors into --out.",
            "airzoo_bench.report.reconstruction:write_clouds",
            files=r".+_(precision|recall)\.ply",
        ),
    ),
    files={"alignment.json": "airzoo_bench.reconstruction.track:write_alignments"},
    baseline=STRUCTURE_FROM_MOTION,
)
