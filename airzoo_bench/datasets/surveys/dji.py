"""A folder of DJI photos with RTK as a dataset of `prepare`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.surveys.options import DjiOptions
from airzoo_bench.datasets.surveys.survey import Survey, given

if TYPE_CHECKING:
    from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["DJI", "DjiFolders"]


class DjiFolders(Survey[DjiOptions]):
    """Photos whose own metadata are the truth: RTK position, gimbal angles."""

    about = About(
        title="DJI photos with RTK",
        page="docs/benchmarks.md",
        licence="your own data",
        assumptions=(
            "Positions are those of *_Timestamp.MRK where there is one, else the photos' own.",
            "The accuracy of the truth is the median of the standard deviations that photos or "
            "time stamps state (RtkStd), unless --truth-accuracy says it.",
            "Orientations are the gimbal's, good to a few degrees: no score of rotations is made.",
            "The camera is DewarpData's; with DewarpFlag 1 without its distortion; without "
            "DewarpData it follows from the focal length of 35 mm film, whose diagonal is "
            "43.27 mm, without distortion.",
            "Heights of photos and time stamps are the surface model's, or --vertical-crs says "
            "what they are above; without a surface model the ground is a plane at the place of "
            "take-off: absolute less relative altitude.",
            "Without a map or surface model in a projected CRS, and without --crs, poses are in "
            "the UTM zone of the photos.",
        ),
        unverified=(
            "Suffix letters of *_Timestamp.MRK: its numbers are read by their order.",
            "Whether DewarpData's principal point holds for photos with DewarpFlag 1.",
        ),
    )
    summary = (
        "Make a benchmark folder out of DJI photos with RTK.\n\n"
        "Their positions and gimbal angles are the truth, so that retrieval is scored; matching "
        "only with --priors from elsewhere, since a prior must not be the truth."
    )
    example = "dji --source DJI_202405 --dom dom.tif --name park --tile-size 256"
    options = DjiOptions
    without_truth = MappingProxyType(
        {
            "matching": "the photos' metadata are the truth, and cannot be the prior too: it needs "
            "--priors of another source",
            "reconstruction": "no true cloud was given (--cloud)",
        }
    )
    needs = ("dom",)

    def reasons(self, options: DjiOptions) -> Mapping[str, str]:
        """Return why a track may have no truth, without asking for what was given."""
        no_dsm = "no surface model was given (--dsm)"
        if options.dsm is not None:
            return self.without_truth
        if options.priors is not None:
            return {**self.without_truth, "matching": no_dsm}
        return {**self.without_truth, "matching": f"{self.without_truth['matching']}, and --dsm"}

    def protocols(self, options: DjiOptions, root: Path) -> BenchmarkProtocols:
        """Return the protocols of own photos; orientations are not trusted."""
        every = super().protocols(options, root)
        matching = every.matching
        if matching is not None:
            scores = matching.scores.model_copy(update={"orientation_is_trusted": False})
            matching = matching.model_copy(update={"scores": scores})
        return replace(every, matching=matching if options.dsm is not None else None)

    def read(self, options: DjiOptions, scene: str, progress: Progress) -> NativeScene:
        """Read the photos' metadata, and tables of time stamps next to them."""
        from airzoo_bench.datasets.surveys.dji_folder import read_folder

        return read_folder(options, scene, given(options.dom, "dom"), progress)


DJI = DjiFolders()
