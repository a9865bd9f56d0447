"""AerialExtreMatch's localisation set: oblique photos of 6-DoF truth, matched to DOM and DSM."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native import NativeDataset
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.published.options import AerialExtreMatchOptions

if TYPE_CHECKING:
    from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["AERIALEXTREMATCH", "AerialExtreMatch"]

SCENE = "localization"


class AerialExtreMatch(NativeDataset[AerialExtreMatchOptions]):
    """The localisation set of AerialExtreMatch."""

    summary = (
        "Make a benchmark folder of AerialExtreMatch's localisation set.\n\n"
        "The folder holds rgb, HQref, LQref, gt_pose.txt and intrinsic.txt. HQ references make the "
        "benchmark aerialextrematch, LQ ones aerialextrematch-lq."
    )
    example = "aerialextrematch --source AerialExtreMatch-Localization"
    options = AerialExtreMatchOptions
    without_truth = MappingProxyType(
        {"matching": "no photo states GPS position and gimbal angles (--priors, or --prior truth)"}
    )
    about = About(
        title="AerialExtreMatch, localization",
        page="https://huggingface.co/datasets/Xecades/AerialExtreMatch-Localization",
        licence="not known here: the dataset's page states it (the code is under the MIT licence)",
        repository="Xecades/AerialExtreMatch-Localization",
        assumptions=(
            "The paper does not say which references it took; HQref is the default here, LQref "
            "makes a benchmark of another name.",
            "Priors are the GPS position and gimbal angles of the photos' own metadata; the "
            "configuration that AerialExtreMatch ships crops by the true pose instead "
            "(--prior truth).",
            "A surface model without a nodata value has no height where its lowest number, if 0 "
            "or less, stands: AerialExtreMatch's code takes heights above 0 only.",
            "Photos have no lens distortion: intrinsic.txt states pinhole cameras.",
            "The yaw_flag of AerialExtreMatch's own evaluation turns queries before matching; it "
            "changes no truth. Matches in turned photos have to be turned back.",
        ),
        unverified=(
            "Whether the GeoTIFFs state their CRS themselves; where not, the .prj next to them "
            "does, and the .tfw is of pixel centres.",
            "Whether the photos as published still carry DJI's metadata.",
        ),
    )

    def benchmark(self, options: AerialExtreMatchOptions) -> str:
        """Return the name, which says what differs from the protocol's."""
        lq, by_truth = options.reference == "lq", options.prior == "truth"
        return "aerialextrematch" + "-lq" * lq + "-truth-prior" * by_truth

    def protocols(self, options: AerialExtreMatchOptions, root: Path) -> BenchmarkProtocols:
        """Return aerialextrematch-matching, or one of the options' name that derives from it."""
        from airzoo_bench.datasets.published.variants import variant_of
        from airzoo_bench.datasets.truths import BenchmarkProtocols
        from airzoo_bench.matching.settings import MatchingProtocol
        from airzoo_bench.protocol.lookup import protocol_of_track

        base = protocol_of_track("aerialextrematch-matching", root, MatchingProtocol)
        changes = {"prior": {"source": options.prior}}
        return BenchmarkProtocols(matching=variant_of(base, self.benchmark(options), changes))

    def scenes(self, options: AerialExtreMatchOptions) -> list[str]:
        """Return the one scene, if its files are there."""
        from airzoo_bench.datasets.published.aerialextrematch_files import localization_files

        localization_files(options.source, options.reference)
        return [SCENE]

    def read(self, options: AerialExtreMatchOptions, scene: str, progress: Progress) -> NativeScene:
        """Read photos, cameras, poses and references."""
        from airzoo_bench.datasets.published.aerialextrematch_files import read_localization

        return read_localization(options.source, options.reference, options.priors, scene, progress)


AERIALEXTREMATCH = AerialExtreMatch()
"""What `prepare aerialextrematch` makes."""
