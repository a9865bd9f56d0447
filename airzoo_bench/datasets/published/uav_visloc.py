"""UAV-VisLoc: eleven flights over China, a satellite map of each."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native import NativeDataset
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.published.options import UavVisLocOptions

if TYPE_CHECKING:
    from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["UAV_VISLOC", "UavVisLoc"]


class UavVisLoc(NativeDataset[UavVisLocOptions]):
    """Photos of eleven flights, to be found on a satellite map of each."""

    about = About(
        title="UAV-VisLoc",
        page="https://github.com/IntelliSensing/UAV-VisLoc",
        licence="none is stated in its README",
        links=("https://github.com/IntelliSensing/UAV-VisLoc",),
        assumptions=(
            "Cameras look straight down (Omega and Kappa are not used), the photo's width across "
            "the heading.",
            "Fields of view: 52 degrees across the heading, 36 along it (--fov-across, "
            "--fov-along), as Game4Loc had them; its later code has 48.44 and 33.48.",
            "Heading: Phi1, clockwise from true north (--heading-column, --heading), as Game4Loc "
            "reads it and as the long sides of six maps lie; the benchmark's own table says 0 is "
            "east. Half a turn changes no truth of retrieval.",
            "07.csv has no column of a heading (only it may lack one): all its photos get -1.5 "
            "degrees, the flight's Phi in the benchmark's table. So do single photos of other "
            "flights whose cell is empty, with their flight's Phi (--missing-heading).",
            "Heights are above the ground, which is a plane (--plane-height). Where they vary by "
            "more than 100 m (5th to 95th percentile; known of 05, 06, 11) they are likely above "
            "sea level: the plane is then put so that their median is 500 m above it "
            "(--height-above-ground).",
            "Positions are taken as they are; a user found some 24 to 48 m off "
            "(IntelliSensing/UAV-VisLoc#5).",
            "How far they may be off: fields of view 8 %, above the 7 % between "
            "Game4Loc's two pairs of values; positions 30 m, within the 24 to 48 m that a user "
            "found; heading 5 degrees and height 30 m, for which there is no source: a drone's "
            "compass, and the relief below a flight that is taken for a plane.",
        ),
        unverified=(
            "The columns of the CSV files, flight 09 in four tiles and 07.csv without a heading "
            "are known from users of the data, not from its README.",
            "How the AirZoo paper came to 26 queries in flight 07 and 444 in flight 09.",
        ),
    )
    summary = (
        "Make UAV-VisLoc's benchmark folder out of its download.\n\nIt serves retrieval. Photos "
        "and maps stay where they are; footprints follow from position, height, heading and field "
        "of view."
    )
    example = "uav-visloc --source UAV_VisLoc_dataset"
    options = UavVisLocOptions

    def benchmark(self, options: UavVisLocOptions) -> str:
        """Return the name."""
        return "uav-visloc"

    def protocols(self, options: UavVisLocOptions, root: Path) -> BenchmarkProtocols:
        """Return the retrieval protocol."""
        from airzoo_bench.datasets.truths import BenchmarkProtocols
        from airzoo_bench.protocol.lookup import protocol_of_track
        from airzoo_bench.retrieval.settings import RetrievalProtocol

        return BenchmarkProtocols(protocol_of_track(options.protocol, root, RetrievalProtocol))

    def scenes(self, options: UavVisLocOptions) -> list[str]:
        """Return the flights whose folders are there."""
        from airzoo_bench.datasets.published.uav_visloc_layout import flight_folders, found_root

        return list(flight_folders(found_root(options.source)))

    def files(self, options: UavVisLocOptions, scene: str) -> Iterable[Path]:
        """Return the flight's photos, table and map, and the range table."""
        from airzoo_bench.datasets.published.uav_visloc_layout import flight_files

        return flight_files(options.source, scene)

    def read(self, options: UavVisLocOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a flight."""
        from airzoo_bench.datasets.published.uav_visloc_flight import read_flight

        return read_flight(options, scene, progress)


UAV_VISLOC = UavVisLoc()
