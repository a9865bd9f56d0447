"""UrbanScene3D: the real scenes that were scanned, by poses from COLMAP or Mega-NeRF."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native import NativeDataset
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.published.options import UrbanScene3DOptions

if TYPE_CHECKING:
    from pathlib import Path

    from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["URBANSCENE3D", "UrbanScene3D"]


class UrbanScene3D(NativeDataset[UrbanScene3DOptions]):
    """The real scenes of UrbanScene3D."""

    summary = (
        "Make a benchmark folder of UrbanScene3D's real scenes.\n\n"
        "UrbanScene3D publishes photos and scans, and no poses. A folder a scene holds what "
        "Mega-NeRF publishes (coordinates.pt, train, val; residence-pixsfm and the like, with "
        "photos), or images and the COLMAP model sparse/0."
    )
    example = (
        "urbanscene3d --source UrbanScene3D --scan residence=residence.ply --transform "
        "residence=residence.txt"
    )
    options = UrbanScene3DOptions
    without_truth = MappingProxyType({})
    about = About(
        title="UrbanScene3D",
        page="https://vcc.tech/UrbanScene3D",
        licence="non-commercial use only; it must not be passed on",
        links=tuple(
            f"https://storage.cmusatyalab.org/mega-nerf-data/{scene}-pixsfm.tgz"
            for scene in ("residence", "sci-art", "campus")
        ),
        assumptions=(
            "Poses are those that the user has, by COLMAP or as Mega-NeRF publishes them; the "
            "paper does not say which it took.",
            "All photos with a pose are taken (--every).",
            "Mega-NeRF's photos have no lens distortion: its script undistorts them.",
        ),
        unverified=(
            "Names, fields and frames of the scans: nobody of us has seen one; so that they are "
            "named with --scan, and their frame with --transform or --same-frame.",
            "The scans of PolyTech and ArtSci that UrbanScene3D's own program measures against are "
            "encrypted and cannot be read.",
        ),
    )

    def benchmark(self, options: UrbanScene3DOptions) -> str:
        """Return the name."""
        return "urbanscene3d"

    def protocols(self, options: UrbanScene3DOptions, root: Path) -> BenchmarkProtocols:
        """Return urbanscene3d-reconstruction."""
        from airzoo_bench.datasets.published.reconstructions import reconstruction_protocol
        from airzoo_bench.datasets.truths import BenchmarkProtocols

        return BenchmarkProtocols(reconstruction=reconstruction_protocol("urbanscene3d", root))

    def scenes(self, options: UrbanScene3DOptions) -> list[str]:
        """Return the scenes whose folders stand below the source."""
        from airzoo_bench.datasets.published.urbanscene3d_files import find_scenes

        return list(find_scenes(options.source))

    def files(self, options: UrbanScene3DOptions, scene: str) -> list[Path]:
        """Return a scene's folder, its scan and its transform."""
        from airzoo_bench.datasets.published.urbanscene3d_files import files_of_scene

        return files_of_scene(options, scene)

    def read(self, options: UrbanScene3DOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a scene's poses, and take them to the frame of its scan."""
        from airzoo_bench.datasets.published.urbanscene3d_files import read_scene

        return read_scene(options, scene, progress)


URBANSCENE3D = UrbanScene3D()
"""What `prepare urbanscene3d` makes."""
