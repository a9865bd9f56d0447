"""An OpenDroneMap project as a dataset of `prepare`."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.surveys.options import OdmOptions
from airzoo_bench.datasets.surveys.survey import WITHOUT_TRUTH, Survey

__all__ = ["ODM", "OdmProjects"]


class OdmProjects(Survey[OdmOptions]):
    """Photos, poses and map of an OpenDroneMap project, or of one split into submodels."""

    about = About(
        title="OpenDroneMap project",
        page="https://docs.opendronemap.org/outputs/",
        licence="your own data",
        assumptions=(
            "Without odm_dem/dsm.tif the surface is gridded from the georeferenced clouds: the "
            "highest point of each cell, whose side holds four points on average (--surface-cell).",
            "A photo of several submodels has the pose of the first.",
            "What remains at ground control points (odm_report/stats.json), or between the poses "
            "that submodels give one photo, is the accuracy of the truth, unless --truth-accuracy "
            "says it.",
            "Map, surface and poses come from the same photos: there is no gap between them.",
        ),
        unverified=(
            "Projects with opensfm/reconstruction.topocentric.json (newer versions): read in "
            "OpenDroneMap's source, not measured.",
        ),
    )
    summary = (
        "Make a benchmark folder out of an OpenDroneMap project.\n\n"
        "Orthophoto, surface model (or else the georeferenced clouds), shots, cameras and "
        "submodels are found in it; --images, --dom and --dsm replace what is found."
    )
    example = "odm --source project --name park --tile-size 256"
    options = OdmOptions
    without_truth = WITHOUT_TRUTH

    def map_of(self, options: OdmOptions) -> Path | None:
        """Return the map that was given, or the project's."""
        from airzoo_bench.datasets.surveys.odm_project import map_of_project

        return map_of_project(options)

    def read(self, options: OdmOptions, scene: str, progress: Progress) -> NativeScene:
        """Read the project."""
        from airzoo_bench.datasets.photos import posed_scene
        from airzoo_bench.datasets.surveys.odm_project import read_project

        found = read_project(options, progress)
        return posed_scene(options, scene, found, progress)


ODM = OdmProjects()
