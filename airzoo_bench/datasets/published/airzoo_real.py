"""AirZoo-Real: two survey regions for retrieval and matching, four sites for reconstruction."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native import NativeDataset
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.published.options import AirZooRealOptions

if TYPE_CHECKING:
    from airzoo_bench.datasets.published.airzoo_real_photos import RegionFiles, RegionOptions
    from airzoo_bench.datasets.truths import BenchmarkProtocols
    from airzoo_bench.retrieval.settings import RetrievalProtocol

__all__ = ["AIRZOO_REAL", "AirZooReal"]

NAME = "airzoo-real"

_RECON = "airzoo_real_recon"
_HOURS = {
    "school": ("xuexiao", "06-08 12-14 18-20 22-24"),
    "driving-school": ("jiaxiao", "06-08 12-14 18-20 22-24"),
    "substation": ("biandian", "06-08 12-14 18-20"),
    "plaza": ("guangchang", "06-08 12-14 18-20"),
}
_SCENE_FILES = {"City": ("Scene1/*",), "Rural": ("Scene2/*",)} | {
    f"{site}-{hours}": (f"*/{folder}/{hours}/*", f"{_RECON}/dom/*", f"{_RECON}/*/dom/*")
    for site, (folder, every) in _HOURS.items()
    for hours in every.split()
}


class AirZooReal(NativeDataset[AirZooRealOptions]):
    """AirZoo's own flights."""

    summary = (
        "Make a benchmark folder of AirZoo-Real.\n\n"
        "Scene1 and Scene2 (City, Rural) serve retrieval and matching, the sites and hours of "
        "airzoo_real_recon reconstruction; parts that are not there are left out."
    )
    example = "airzoo-real --source AirZoo-Real"
    options = AirZooRealOptions
    without_truth = MappingProxyType({})
    about = About(
        title="AirZoo-Real",
        page="https://huggingface.co/datasets/RingoWRW97/AirZoo-Real",
        licence="not known here: its page, which asks to accept conditions, states it",
        repository="RingoWRW97/AirZoo-Real",
        scene_files=MappingProxyType(_SCENE_FILES),
        assumptions=(
            "True positions of City and Rural are --positions, else DJI's RTK tables (.MRK) where "
            "they have a fixed solution for every photo, else the photos' own where RtkFlag is 50; "
            "sources are not mixed, photos without are left out.",
            "Orientations of City and Rural are the gimbal's; they place footprints and crops, and "
            "no score rests on them.",
            "RTK heights and the surface model have one vertical datum (--height-offset).",
            "Cameras of City and Rural are as DJI calibrated them (DewarpData), else they follow "
            "from the focal length of 35 mm film, by the diagonal, without distortion (--camera).",
            "Retrieval's map is the raster of 0.3 m a pixel, give or take 15 %, or --satellite; "
            "the paper took Google's, which may not be in the release.",
            "A prior that equals the truth is none: where both are the photos' RTK, matching has "
            "no truth but by --priors, --positions or --prior truth.",
            "The true cloud of a site is its surface model within 500 m of the cameras "
            "(--truth-reach), or --cloud: the metric depth that the paper took is not in the "
            "release. It has no facades.",
            "Camera axes of the sites are OpenGL's, and cameras are scaled from 4032x3024 to the "
            "photos' 1008x756.",
        ),
        unverified=(
            "Names of the files in Scene1 and Scene2, and whether a satellite map is among them.",
            "The layout of airzoo_real_recon, its axes and scale, known from one user's notes.",
            "The vertical datum of DSM and RTK heights.",
        ),
    )

    def benchmark(self, options: AirZooRealOptions) -> str:
        """Return the name, which says where priors are the truth."""
        return NAME + "-truth-prior" * (options.prior == "truth")

    def protocols(self, options: AirZooRealOptions, root: Path) -> BenchmarkProtocols:
        """Return the protocols of the parts that are there."""
        from airzoo_bench.datasets.published.airzoo_real_photos import REGIONS
        from airzoo_bench.datasets.published.variants import variant_of
        from airzoo_bench.datasets.truths import BenchmarkProtocols
        from airzoo_bench.matching.settings import MatchingProtocol
        from airzoo_bench.protocol.lookup import protocol_of_track
        from airzoo_bench.reconstruction.settings import ReconstructionProtocol

        wanted = options.scene or self.scenes(options)
        regions = [scene for scene in wanted if scene in REGIONS]
        matching = protocol_of_track(f"{NAME}-matching", root, MatchingProtocol)
        if options.prior == "truth":
            changes = {"prior": {"source": "truth"}}
            by_truth = variant_of(matching, self.benchmark(options), changes)
            return BenchmarkProtocols(matching=by_truth)
        sites = protocol_of_track(f"{NAME}-reconstruction", root, ReconstructionProtocol)
        maps = [_region(options, scene).satellite for scene in regions]
        return BenchmarkProtocols(
            _retrieval(root) if maps and None not in maps else None,
            matching if regions else None,
            sites if len(wanted) > len(regions) else None,
        )

    def scenes(self, options: AirZooRealOptions) -> list[str]:
        """Return City, Rural, and the sites by hours, as far as they are there."""
        from airzoo_bench.datasets.published.airzoo_real_photos import REGIONS, region_home
        from airzoo_bench.datasets.published.airzoo_real_sites import site_scenes

        home = _home(options)
        regions = [scene for scene in REGIONS if region_home(home, scene) is not None]
        return regions + ([] if options.prior == "truth" else site_scenes(home))

    def files(self, options: AirZooRealOptions, scene: str) -> list[Path]:
        """Return the scene's folder, the surface model of the sites, and what options name."""
        from airzoo_bench.datasets.published.airzoo_real_photos import REGIONS, region_home
        from airzoo_bench.datasets.published.airzoo_real_sites import site_files

        if scene not in REGIONS:
            return [*site_files(_home(options), scene), *_clouds(options, scene)]
        home, said = region_home(_home(options), scene), _said_of(options, scene)
        return [file for file in (home, *said.files) if file is not None]

    def read(self, options: AirZooRealOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a region or a site."""
        from airzoo_bench.datasets.published.airzoo_real_photos import REGIONS, read_region
        from airzoo_bench.datasets.published.airzoo_real_sites import read_site

        if scene in REGIONS:
            return read_region(_region(options, scene), scene, _said_of(options, scene), progress)
        cloud = next(iter(_clouds(options, scene)), None)
        return read_site(_home(options), scene, cloud, options.truth_reach, progress)


def _home(options: AirZooRealOptions) -> Path:
    from airzoo_bench.datasets.published.airzoo_real_photos import REGIONS
    from airzoo_bench.datasets.published.airzoo_real_sites import SITES
    from airzoo_bench.datasets.published.places import find_home

    parts = (*REGIONS.values(), "airzoo_real_recon", *SITES.values())
    return find_home(options.source, parts, "AirZoo-Real as it is downloaded and unpacked")


def _retrieval(root: Path) -> RetrievalProtocol:
    from airzoo_bench.protocol.lookup import protocol_of_track
    from airzoo_bench.retrieval.settings import RetrievalProtocol

    return protocol_of_track(f"{NAME}-retrieval", root, RetrievalProtocol)


def _region(options: AirZooRealOptions, scene: str) -> RegionFiles:
    from airzoo_bench.core.files import data_root
    from airzoo_bench.datasets.published.airzoo_real_photos import region_files

    gallery, _ = _retrieval(data_root()).map_rules()
    gsd = 0.0 if isinstance(gallery.gsd_m, str) else gallery.gsd_m
    said = _said_of(options, scene)
    return region_files(_home(options), scene, said, (gsd, gallery.gsd_tolerance))


def _said_of(options: AirZooRealOptions, scene: str) -> RegionOptions:
    from airzoo_bench.core.errors import UsageError
    from airzoo_bench.datasets.published.airzoo_real_photos import RegionOptions

    names = ("dom", "dsm", "satellite", "positions", "priors", "camera")
    named = {name: _by_scene(getattr(options, name), name).get(scene) for name in names}
    files = {name: Path(file) for name, file in named.items() if file is not None}
    offset = _by_scene(options.height_offset, "height-offset").get(scene, "0")
    try:
        metres = float(offset)
    except ValueError as error:
        raise UsageError(f"--height-offset {offset[:40]!r} is no number") from error
    return RegionOptions(**files, height_offset_m=metres)


def _clouds(options: AirZooRealOptions, scene: str) -> list[Path]:
    """Return the true cloud that was given for a scene, or for its site at all hours."""
    given = _by_scene(options.cloud, "cloud")
    names = (scene, scene.rsplit("-", 2)[0])
    return [Path(given[name]) for name in names if name in given][:1]


def _by_scene(given: list[str] | None, option: str) -> dict[str, str]:
    from airzoo_bench.core.errors import UsageError
    from airzoo_bench.datasets.published.airzoo_real_photos import REGIONS
    from airzoo_bench.datasets.published.airzoo_real_sites import SITE_SCENES, SITES

    known = [*REGIONS]
    if option == "cloud":
        known = [*SITES, *SITE_SCENES]
    pairs = [text.partition("=") for text in given or ()]
    for scene, equals, value in pairs:
        if scene not in known or not equals or not value:
            raise UsageError(
                f"--{option} {scene}{equals}{value}",
                expected=f"SCENE=..., the scene being one of {', '.join(known)}",
            )
    return {scene: value for scene, _, value in pairs}


AIRZOO_REAL = AirZooReal()
"""What `prepare airzoo-real` makes."""
