"""AerialExtreMatch's localisation set: oblique photos of 6-DoF truth, matched to DOM and DSM.

::

    rgb/<name>.JPG     queries
    gt_pose.txt        name qw qx qy qz tx ty tz: world-to-camera, OpenCV axes, EPSG:4547
    intrinsic.txt      name PINHOLE width height fx fy cx cy
    HQref/, LQref/     an orthophoto and a surface model as GeoTIFF, with .prj and .tfw

Names agree up to their first point.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import data_root
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.metadata import metadata_priors, photo_metadata
from airzoo_bench.datasets.published.maps import find_maps, only_one, with_georeference
from airzoo_bench.datasets.published.places import (
    files_by_key,
    find_home,
    needed_path,
    stem_key,
    sub_path,
)
from airzoo_bench.datasets.published.pose_lines import read_posed_lines
from airzoo_bench.datasets.scenes import NativeScene
from airzoo_bench.datasets.settings import SourceOptions
from airzoo_bench.datasets.truths import BenchmarkProtocols, variant_of
from airzoo_bench.geometry.crs import check_same_crs
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.protocol.lookup import protocol_of_track

_CRS = "EPSG:4547"
_SCENE = "localization"
_FOLDERS = {"hq": "HQref", "lq": "LQref"}
_LAYOUT = "rgb/*.JPG, gt_pose.txt, intrinsic.txt, and HQref/*.tif or LQref/*.tif"


@dataclass(frozen=True)
class AerialExtreMatchOptions(SourceOptions):
    """Differences from the paper's protocol."""

    reference: Literal["hq", "lq"] = "hq"
    prior: Literal["metadata", "truth"] = "metadata"
    priors: Path | None = None


class AerialExtreMatch(Dataset[AerialExtreMatchOptions]):
    """The localisation set of AerialExtreMatch."""

    name = "aerialextrematch"
    about = about_of("aerialextrematch")
    options = AerialExtreMatchOptions

    def benchmark_protocols(
        self, options: AerialExtreMatchOptions, root: Path
    ) -> BenchmarkProtocols:
        """Return aerialextrematch-matching, or one of the options' name that derives from it."""
        lq, by_truth = options.reference == "lq", options.prior == "truth"
        benchmark = self.name + "-lq" * lq + "-truth-prior" * by_truth
        base = protocol_of_track("aerialextrematch-matching", root, MatchingProtocol)
        changes = {"prior": {"source": options.prior}}
        return BenchmarkProtocols((variant_of(base, benchmark, changes),))

    def scenes(self, options: AerialExtreMatchOptions) -> Mapping[str, Sequence[Path]]:
        """Return the one scene, if its files are there."""
        priors = () if options.priors is None else (options.priors,)
        return {_SCENE: (*_parts(options), *priors)}

    def read(self, options: AerialExtreMatchOptions, scene: str, progress: Progress) -> NativeScene:
        """Read photos, cameras, poses and references."""
        images, poses, cameras, references = _parts(options)
        photos = files_by_key(images, stem_key, _LAYOUT)
        posed = read_posed_lines(images, photos, poses, cameras, stem_key, progress)
        names = posed.photos.names
        metadata = photo_metadata(names, images, options.priors, photos.values(), progress)
        maps, surfaces = find_maps(references)
        move = "leave one in the folder, the others elsewhere"
        made = data_root() / "made" / self.name / f"{scene}-{options.reference}"
        dom, notes = with_georeference(only_one(maps, "orthophoto", references, move), made)
        surface = only_one(surfaces, "surface model", references, move)
        dsm, more = with_georeference(surface, made, heights=True)
        for path in (dom, dsm):
            check_same_crs(_CRS, open_info(path).crs, f"the poses and {path.name}")
        return NativeScene(
            scene,
            images,
            names,
            posed.photos.cameras,
            posed.photos.poses,
            _CRS,
            dom=dom,
            dsm=dsm,
            priors=metadata_priors(metadata, _CRS),
            metadata=metadata,
            unposed=posed.unposed,
            notes=(*posed.notes, f"references of {references.name}", *notes, *more),
            poses_from=poses,
        )


def _parts(options: AerialExtreMatchOptions) -> tuple[Path, ...]:
    """Return photos, poses, cameras and references of the localisation set."""
    if sub_path(options.source, "class_0") and not sub_path(options.source, "gt_pose.txt"):
        raise BenchmarkError(
            "these are AerialExtreMatch's evaluation pairs, class_0 to class_31, whose .npy files "
            "are Python pickles, which are never loaded here",
            where=options.source,
            expected=f"the localization set: {_LAYOUT}",
            fix="where you trust them, write them as .npz and score poses by "
            "airzoo_bench.pose_errors: docs/benchmarks.md has the lines",
        )
    home = find_home(options.source, lambda f: sub_path(f, "gt_pose.txt") is not None, _LAYOUT)
    parts = ("rgb", "gt_pose.txt", "intrinsic.txt", _FOLDERS[options.reference])
    return tuple(needed_path(home, one, _LAYOUT) for one in parts)


AERIALEXTREMATCH = AerialExtreMatch()
