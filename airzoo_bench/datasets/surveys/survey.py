"""Own photos: options, protocols, a scene of posed photos, its heights; and `prepare photos`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pyproj import CRS

from airzoo_bench.core.errors import CameraError, UsageError, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.validation import SAFE_NAME
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.content import metric_crs, photo_sizes
from airzoo_bench.datasets.dataset import Dataset, path_options
from airzoo_bench.datasets.metadata import metadata_priors, photo_metadata
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos, check_centred
from airzoo_bench.datasets.settings import PhotoOptions, SceneOptions
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.crs import describe_crs, horizontal_crs, vertical_m
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.protocol.model import find_protocol, protocol_for

_LONGEST_NAME = 48  # of which more names are made
_TRACKS = ("retrieval", "matching", "reconstruction")

OptionsT = TypeVar("OptionsT", bound=SceneOptions)


class Survey(Dataset[OptionsT]):
    """One scene of own photos; its protocols start from the shipped ones for photos.

    `needs` are the fields of options that must be given; `needs_ground` says that a surface model
    or a plane must be given as well.
    """

    needs: ClassVar[Sequence[str]] = ()
    needs_ground: ClassVar[bool] = False

    def benchmark(self, options: Any) -> str:
        """Return the name that was given, or the source's."""
        name = options.name or options.source.resolve().stem
        if not re.fullmatch(SAFE_NAME, name) or len(name) > _LONGEST_NAME:
            raise UsageError(
                f"{name[:80]!r} cannot be the name of a benchmark",
                where="--name" if options.name else options.source,
                expected=f"letters, digits, '.', '_' and '-', at most {_LONGEST_NAME}",
                fix="name it with --name",
            )
        return str(name)

    def scenes(self, options: Any) -> Mapping[str, Sequence[Path]]:
        """Return the one scene, called like the benchmark, if all that it needs was given."""
        lacking = [f"--{field}" for field in self.needs if getattr(options, field) is None]
        if self.needs_ground and options.dsm is None and options.plane_height is None:
            lacking.append("--dsm (a surface model), or --plane-height")
        if lacking:
            raise UsageError(f"{' and '.join(lacking)} must be given")
        return {self.benchmark(options): path_options(options)}

    def benchmark_protocols(self, options: Any, root: Path) -> BenchmarkProtocols:
        """Return the protocols of own photos, as changed by the options."""
        named = [find_protocol(one, root) for one in options.protocol or ()]
        given: dict[str, Any] = {one.track: one for one in named}
        bases: list[Any] = [
            given.get(track) or find_protocol(f"photos-{track}", root) for track in _TRACKS
        ]
        truth, sizes = bases[0].map_rules()[1], tuple(options.tile_size or ())
        rule, above = options.rule or truth.rule, options.iou_above
        if above is None and rule == "iou":
            above = truth.iou_above
        changes: dict[str, dict[str, Any]] = {
            "gallery": {"tile_sizes_px": sizes} if sizes else {},
            "ground_truth": {"rule": rule, "iou_above": above},
        }
        name = self.benchmark(options)
        return BenchmarkProtocols(
            tuple(protocol_for(one, name, changes if one is bases[0] else {}) for one in bases)
        )


def stated_crs(options: SceneOptions) -> CRS | None:
    """Return the CRS that ``--crs`` states, which must be projected and in metres."""
    return None if options.crs is None else metric_crs(options.crs, f"--crs {options.crs}")


def map_crs(dsm: Path | None, dom: Path | None) -> CRS:
    """Return the projected CRS of the surface model, or of the map where there is none."""
    path = dsm or dom or Path()
    crs = horizontal_crs(open_info(path).crs)
    if not crs.is_projected:
        what = f"is in {describe_crs(crs)}, in which poses have no metres"
        raise CameraError(what, where=path, fix="give the UTM zone: --crs, or the class's crs")
    return crs


def posed_scene(
    options: Any,
    scene: str,
    images: Path,
    sizes: Mapping[str, tuple[int, int]],
    photos: PosedPhotos,
    poses_from: Path,
    progress: Progress,
    *,
    crs_from: str = "",
    **parts: Any,
) -> NativeScene:
    """Make the scene of posed photos, its priors from the photos' metadata and ``--priors``.

    `sizes` are of every photo below `images`; `poses_from` and `crs_from` are for messages, `parts`
    go before those of the options.
    """
    check_centred(photos, poses_from)
    stated = options.crs or photos.crs
    place = f"--crs {options.crs}" if options.crs else crs_from or str(poses_from)
    crs = metric_crs(stated, place).to_string()
    unit = vertical_m(CRS.from_user_input(stated)) or 1.0
    poses = replace(photos.poses, centres=photos.poses.centres * (1.0, 1.0, unit))
    named = {"dom": options.dom, "dsm": options.dsm, "cloud": options.cloud}
    named |= {"plane_height_m": options.plane_height, **parts}
    if "metadata" not in parts:
        metadata = photo_metadata(photos.names, images, options.priors, sizes, progress)
        named = {"metadata": metadata, "priors": metadata_priors(metadata, crs), **named}
    named["truth_accuracy_m"] = options.truth_accuracy or parts.get("truth_accuracy_m")
    if photos.absent:
        counts = first_of(photos.absent, len(photos.absent) + len(photos.names))
        named["notes"] = (*parts.get("notes", ()), f"poses without a photo: {counts}")
    return NativeScene(
        scene,
        images,
        *photos._replace(poses=poses, crs=crs),
        unposed=tuple(sorted(set(sizes) - set(photos.names))),
        poses_from=poses_from,
        crs_from=place,
        **named,
    )


class _Photos(Survey[PhotoOptions]):
    """A scene of own photos."""

    about = load_about("photos")
    options = PhotoOptions
    needs_ground = True

    def read(self, options: PhotoOptions, scene: str, progress: Progress) -> NativeScene:
        images, poses = options.images, options.poses
        sizes = photo_sizes(images, progress)
        photos, crs_from = read_poses(poses, sizes), f"{poses}, key 'crs'"
        if options.crs is None and not photos.crs:
            fix = "add the key 'crs' to the file, or give --crs EPSG:..."
            raise UsageError("the CRS of the poses is not known", where=poses, fix=fix)
        parts = (scene, images, sizes, photos, poses, progress)
        return posed_scene(options, *parts, crs_from=crs_from)


PHOTOS = _Photos()
