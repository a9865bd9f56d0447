"""AirZoo-Test, and AirZoo's own frames: rendered photos with exact depth and poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.native import NativeDataset
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.published.options import AIRZOO_TEST_NAME, AirZooTestOptions

if TYPE_CHECKING:
    from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["AIRZOO_TEST", "AirZooTest"]


class AirZooTest(NativeDataset[AirZooTestOptions]):
    """Trajectories of AirZoo."""

    summary = (
        "Make a benchmark folder of AirZoo-Test, or of other trajectories of AirZoo.\n\n"
        "Each trajectory is a folder with frames.csv, images and depth. The true cloud is made of "
        "the depth of the frames that are taken."
    )
    example = "airzoo-test --source AirZoo-Test"
    options = AirZooTestOptions
    without_truth = MappingProxyType({})
    about = About(
        title="AirZoo-Test",
        page="https://huggingface.co/datasets/choyaa/AirZoo-Data",
        licence="stated on the dataset's page, which is gated",
        repository="choyaa/AirZoo-Data",
        assumptions=(
            "The frames that a reconstruction is made from are every thirtieth, one a second "
            "(--every); the paper does not say which it took.",
            "The true cloud is the surface that the depth of these frames shows, up to the "
            "protocol's fusion.max_depth_m, a point in each voxel of the protocol's "
            "preparation.voxel_m.",
            "The sixteen trajectories are numbered by their folders' names, in which numbers "
            "count as such (2 before 10).",
            "Depth is in metres along the optical axis (--depth-kind, --depth-scale).",
        ),
        unverified=(
            "The layout of AirZoo's archives, the names of the test trajectories, the encoding of "
            "depth and the axes of poses: nobody of us has seen them. What is read is the layout "
            "that airzoo-bench writes frames in: frames.csv, images/, depth/.",
        ),
    )

    def benchmark(self, options: AirZooTestOptions) -> str:
        """Return the name."""
        return options.name

    def protocols(self, options: AirZooTestOptions, root: Path) -> BenchmarkProtocols:
        """Return airzoo-test-reconstruction, or one of the trajectories that are there."""
        from airzoo_bench.datasets.published.airzoo_test_files import trajectory_protocol
        from airzoo_bench.datasets.truths import BenchmarkProtocols

        return BenchmarkProtocols(reconstruction=trajectory_protocol(options, root))

    def scenes(self, options: AirZooTestOptions) -> list[str]:
        """Return the ids of the trajectories."""
        from airzoo_bench.datasets.published.airzoo_test_files import find_trajectories

        return list(find_trajectories(options.source, published=options.name == AIRZOO_TEST_NAME))

    def files(self, options: AirZooTestOptions, scene: str) -> list[Path]:
        """Return a trajectory's folder."""
        from airzoo_bench.datasets.published.airzoo_test_files import find_trajectories

        return [
            find_trajectories(options.source, published=options.name == AIRZOO_TEST_NAME)[scene]
        ]

    def read(self, options: AirZooTestOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a trajectory, and make its true cloud if that has not been made yet."""
        from airzoo_bench.datasets.published.airzoo_test_files import read_trajectory

        return read_trajectory(options, scene, progress)

    def is_prepared(self, options: AirZooTestOptions, settings: PrepareSettings) -> bool:
        """Whether the folder is complete, and made from files that did not change since."""
        return super().is_prepared(_with_clouds(options, settings), settings)

    def prepare(self, options: AirZooTestOptions, settings: PrepareSettings) -> Prepared:
        """Make the benchmark folder; true clouds are kept, so that they are not made again."""
        return super().prepare(_with_clouds(options, settings), settings)


def _with_clouds(options: AirZooTestOptions, settings: PrepareSettings) -> AirZooTestOptions:
    """Return the options with a folder for clouds, in the data root where none is named."""
    clouds = options.clouds or settings.root / f"{options.name}-clouds"
    return replace(options, clouds=clouds)


AIRZOO_TEST = AirZooTest()
"""What `prepare airzoo-test` makes."""
