"""UAVScenes: 20 flights over four places, each against the DJI Terra cloud of its place."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native import NativeDataset
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.published.options import UavScenesOptions

if TYPE_CHECKING:
    from pathlib import Path

    from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["UAVSCENES", "UavScenes"]


class UavScenes(NativeDataset[UavScenesOptions]):
    """The runs of UAVScenes."""

    summary = (
        "Make a benchmark folder of UAVScenes.\n\n"
        "The source holds interval5_CAM_LIDAR and terra_3dmap_pointcloud_mesh, unpacked. Photos "
        "and clouds are left where they are."
    )
    example = "uavscenes --source UAVScenes --scene AMtown01"
    options = UavScenesOptions
    without_truth = MappingProxyType({})
    about = About(
        title="UAVScenes",
        page="https://github.com/sijieaaa/UAVScenes",
        licence="CC BY-NC-SA 4.0, academic use only",
        repository="sijieaaa/UAVScenes",
        assumptions=(
            "The photos that a reconstruction is made from are every tenth of interval5 (--every, "
            "--interval), about five seconds apart; the paper does not say which it took.",
            "The cloud of a run is that of its place: of HKairport_GNSS01 the one in "
            "HKairport_GNSS, or else in HKairport (--cloud RUN=FILE names another).",
            "T4x4 is camera-to-world with OpenCV axes, in the frame of the place's cloud, in "
            "metres and with z up.",
            "P3x3 counts pixels from the image's corner.",
            "Photos have the lens distortion K1, K2, K3, P1, P2 of the poses' file, and none where "
            "it states none (--lens none).",
        ),
        unverified=(
            "The names of the runs beyond AMtown, AMvalley and HKairport01: nobody of us has seen "
            "the archives.",
            "Whether the photos are undistorted already, and whether the HKairport_GNSS and "
            "HKisland_GNSS runs have clouds of their own.",
        ),
    )

    def benchmark(self, options: UavScenesOptions) -> str:
        """Return the name."""
        return "uavscenes"

    def protocols(self, options: UavScenesOptions, root: Path) -> BenchmarkProtocols:
        """Return uavscenes-reconstruction."""
        from airzoo_bench.datasets.published.reconstructions import reconstruction_protocol
        from airzoo_bench.datasets.truths import BenchmarkProtocols

        return BenchmarkProtocols(reconstruction=reconstruction_protocol("uavscenes", root))

    def scenes(self, options: UavScenesOptions) -> list[str]:
        """Return the runs whose folders stand below the source."""
        from airzoo_bench.datasets.published.uavscenes_files import find_runs

        return list(find_runs(options.source, options.interval))

    def files(self, options: UavScenesOptions, scene: str) -> list[Path]:
        """Return a run's folder and the clouds that could be its own."""
        from airzoo_bench.datasets.published.uavscenes_files import files_of_run

        return files_of_run(options, scene)

    def read(self, options: UavScenesOptions, scene: str, progress: Progress) -> NativeScene:
        """Read the poses and the sizes of a run's photos."""
        from airzoo_bench.datasets.published.uavscenes_files import read_run

        return read_run(options, scene, progress)


UAVSCENES = UavScenes()
"""What `prepare uavscenes` makes."""
