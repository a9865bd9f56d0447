"""Own photos as a dataset of `prepare`."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.dataset import Dataset, Prepared, PrepareSettings
from airzoo_bench.datasets.photo_options import PhotoOptions, ProtocolOptions, Rule

if TYPE_CHECKING:
    from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["PHOTOS", "Photos", "photo_protocols", "say_tile_sizes"]

_LONGEST_NAME = 48  # of which more names are made


class Photos(Dataset[PhotoOptions]):
    """A scene of own photos, their poses, a map and a surface model."""

    summary = (
        "Make a benchmark folder out of photos, their poses, a map and a surface model.\n\n"
        "It serves retrieval; matching where the photos' metadata hold GPS and gimbal angles; and "
        "reconstruction where there is a true --cloud."
    )
    example = (
        "photos --name park --images photos --poses poses.json --dom dom.tif --dsm dsm.tif "
        "--tile-size 512 --rule iou --iou-above 0.39"
    )
    options = PhotoOptions
    jobs = 1
    without_truth = MappingProxyType(
        {
            "matching": "no photo has GPS position and gimbal angles (--priors)",
            "reconstruction": "no true cloud was given (--cloud)",
        }
    )

    def benchmark(self, options: PhotoOptions) -> str:
        """Return the name that was given, if names of files and protocols can be made of it."""
        from airzoo_bench.core.validation import SAFE_NAME

        name = options.name
        if not re.fullmatch(SAFE_NAME, name) or len(name) > _LONGEST_NAME:
            raise UsageError(
                f"--name {name[:80]!r} cannot be the name of a benchmark",
                expected="letters, digits, '.', '_' and '-', beginning with a letter or digit, at "
                f"most {_LONGEST_NAME} characters",
            )
        return name

    def is_prepared(self, options: PhotoOptions, settings: PrepareSettings) -> bool:
        """Whether the folder is complete, and made from files that did not change since."""
        from airzoo_bench.datasets.native_prepare import is_prepared
        from airzoo_bench.datasets.photos import photo_source

        protocols = photo_protocols(options, options.name, settings.root, options.dom)
        source = photo_source(options, protocols)
        return is_prepared(source, protocols, settings)

    def prepare(self, options: PhotoOptions, settings: PrepareSettings) -> Prepared:
        """Make the folder, see `photos.prepare_photos`."""
        from airzoo_bench.datasets.photos import prepare_photos

        say_tile_sizes(options, options.dom, settings.note)
        protocols = photo_protocols(options, options.name, settings.root, options.dom)
        return prepare_photos(options, protocols, settings)


def photo_protocols(
    options: ProtocolOptions, name: str, root: Path, dom: Path | None
) -> BenchmarkProtocols:
    """Return the protocols of a benchmark with one scene, started from those that options name."""
    from airzoo_bench.datasets.truths import BenchmarkProtocols
    from airzoo_bench.matching.settings import MatchingProtocol
    from airzoo_bench.protocol.lookup import protocol_for, protocol_of_track
    from airzoo_bench.reconstruction.settings import ReconstructionProtocol
    from airzoo_bench.retrieval.settings import RetrievalProtocol

    base = protocol_of_track(options.protocol, root, RetrievalProtocol)
    matching = protocol_of_track(options.matching_protocol, root, MatchingProtocol)
    reconstruction = protocol_of_track(
        options.reconstruction_protocol, root, ReconstructionProtocol
    )
    truth, sizes = base.map_rules()[1], _tile_sizes_px(options, dom)
    changes: dict[str, dict[str, Any]] = {
        "gallery": {"tile_sizes_px": sizes} if sizes else {},
        "ground_truth": {
            "rule": options.rule or truth.rule,
            "iou_above": _threshold(truth.iou_above, options.rule, options.iou_above),
        },
    }
    return BenchmarkProtocols(
        protocol_for(base, name, changes),
        protocol_for(matching, name, {}),
        protocol_for(reconstruction, name, {}),
    )


def _tile_sizes_px(options: ProtocolOptions, dom: Path | None) -> tuple[int, ...]:
    """Return the sides of tiles that were asked for, in pixels of the map; none for the default."""
    in_metres = options.tile_size_m
    if not in_metres:
        return tuple(options.tile_size or ())
    if options.tile_size:
        raise UsageError("--tile-size and --tile-size-m are both given", fix="give one of them")
    pixel = _pixel_m(dom)
    sizes = tuple(round(side / pixel) if side > 0 else 0 for side in in_metres)
    if min(sizes) < 1:
        raise UsageError(
            f"--tile-size-m {min(in_metres):g} is less than a pixel of the map",
            expected=f"more than {pixel:.3g} m",
        )
    return sizes


def _pixel_m(dom: Path | None) -> float:
    from airzoo_bench.geometry.rasters import gsd_m, open_info

    if dom is None:
        raise UsageError("--tile-size-m needs a map", fix="give --dom, or --tile-size in pixels")
    return math.sqrt(math.prod(gsd_m(open_info(dom))))


def say_tile_sizes(options: ProtocolOptions, dom: Path | None, note: Callable[[str], None]) -> None:
    """Say which sides in pixels those in metres have become, see `photo_protocols`."""
    if options.tile_size_m:
        gsd = f"at {_pixel_m(dom):.4g} m per pixel"
        for side, size in zip(options.tile_size_m, _tile_sizes_px(options, dom), strict=True):
            note(f"tiles of {side:g} m are {size} px of the map, {gsd}")


def _threshold(base: float | None, rule: Rule | None, given: float | None) -> float | None:
    """Return the overlap to use: the one given, else the protocol's if the rule is overlap."""
    goes_by_overlap = rule == "iou" or (rule is None and base is not None)
    return base if given is None and goes_by_overlap else given


PHOTOS = Photos()
