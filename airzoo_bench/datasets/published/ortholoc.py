"""OrthoLoC: photos of 47 places, each with the orthophoto and surface model of what it shows."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native import NativeDataset, NativeOptions
from airzoo_bench.datasets.native_scene import NativeScene

if TYPE_CHECKING:
    from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["ORTHOLOC", "OrthoLoc"]


class OrthoLoc(NativeDataset[NativeOptions]):
    """The two test sets of OrthoLoC, a scene each."""

    about = About(
        title="OrthoLoC",
        page="https://github.com/deepscenario/OrthoLoC",
        licence="CC BY-NC-SA 4.0",
        links=("https://cvg.cit.tum.de/webshare/g/papers/Dhaouadi/OrthoLoC/",),
        assumptions=(
            "The pose of a photo is extrinsics, not extrinsics_refined, as in OrthoLoC's own "
            "benchmark.",
            "Whole numbers are centres of pixels in intrinsics, and in scale and dsm, as in "
            "OrthoLoC's code: both are moved by half a pixel.",
            "Samples have frames of their own. Their GeoTIFFs name a transverse Mercator at 0 N, "
            "0 E, since files without a CRS are not read: it is no place on the earth.",
            "Photos that are black are left out, as OrthoLoC's loader does.",
            "Thresholds of poses are those of OrthoLoC's code; poses are solved as in the other "
            "protocols here, where OrthoLoC takes PoseLib.",
        ),
        unverified=(
            "No sample was seen: keys, shapes and conventions are those of OrthoLoC's README and "
            "loader. A grid of dsm that is not the one that scale states is refused.",
            "How many samples each set has: 16,427 are published for all four.",
        ),
    )
    summary = (
        "Make a benchmark folder of OrthoLoC's test sets.\n\n"
        "Each sample (.npz) becomes a photo, a map and a surface model, written once below the "
        "data root; photos are matched to the whole of their own map."
    )
    example = "ortholoc --source OrthoLoC/full"
    options = NativeOptions
    without_truth = MappingProxyType({"matching": "no sample has a photo and a map"})

    def benchmark(self, options: NativeOptions) -> str:
        """Return the name."""
        return "ortholoc"

    def protocols(self, options: NativeOptions, root: Path) -> BenchmarkProtocols:
        """Return ortholoc-matching."""
        from airzoo_bench.datasets.truths import BenchmarkProtocols
        from airzoo_bench.matching.settings import MatchingProtocol
        from airzoo_bench.protocol.lookup import protocol_of_track

        return BenchmarkProtocols(
            matching=protocol_of_track("ortholoc-matching", root, MatchingProtocol)
        )

    def scenes(self, options: NativeOptions) -> list[str]:
        """Return the test sets whose folders are there."""
        from airzoo_bench.datasets.published.ortholoc_files import find_sets

        return list(find_sets(options.source))

    def files(self, options: NativeOptions, scene: str) -> Iterable[Path]:
        """Return the folder of the set."""
        from airzoo_bench.datasets.published.ortholoc_files import find_sets

        return [find_sets(options.source)[scene]]

    def read(self, options: NativeOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a set, and write its photos and maps."""
        from airzoo_bench.datasets.published.ortholoc_files import read_set

        return read_set(options.source, scene, progress)


ORTHOLOC = OrthoLoc()
"""What `prepare ortholoc` makes."""
