"""What all own photos have in common: options, protocols, and a scene of posed photos."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pyproj import CRS

from airzoo_bench.core.errors import CameraError, UsageError
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.registry import Option
from airzoo_bench.core.validation import SAFE_NAME
from airzoo_bench.datasets.content import check_names, metric_crs
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.heights import surface_altitudes, surface_centres
from airzoo_bench.datasets.metadata import metadata_priors, photo_metadata
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos, check_centred
from airzoo_bench.datasets.settings import Prepared, PrepareSettings, SourceOptions, path_options
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.crs import describe_crs, horizontal_crs
from airzoo_bench.geometry.rasters import gsd_m, open_info
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.protocol.lookup import protocol_for, protocol_of_track
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.retrieval.settings import RetrievalProtocol

__all__ = ["FoundPhotos", "SceneOptions", "Survey", "SurveyOptions", "posed_scene"]

_LONGEST_NAME = 48  # of which more names are made


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """The further parts of a scene, and what differs from the protocols to start from."""

    dsm: Annotated[
        Path | None, Option("dsm", "Surface model, GeoTIFF in the CRS of the poses.")
    ] = None
    cloud: Annotated[
        Path | None,
        Option("cloud", "True cloud in the CRS of the poses (.las, .laz, .ply ...), if any."),
    ] = None
    priors: Annotated[
        Path | None,
        Option(
            "priors", "CSV of positions and gimbal angles, where the photos' metadata lack them."
        ),
    ] = None
    crs: Annotated[
        str | None, Option("crs", "Projected CRS of the poses (default: what their file says).")
    ] = None
    plane_height: Annotated[
        float | None,
        Option(
            "plane-height",
            "Height of the ground as a plane, in the poses' vertical datum (default: the median "
            "of the surface model).",
        ),
    ] = None
    vertical_crs: Annotated[
        str | None,
        Option(
            "vertical-crs",
            "Vertical CRS of the poses, to convert heights to the DSM's, such as EPSG:4979 "
            "(ellipsoid) or EPSG:5773 (EGM96).",
        ),
    ] = None
    priors_vertical_crs: Annotated[
        str | None, Option("priors-vertical", "Vertical CRS of altitudes in metadata and --priors.")
    ] = None
    dsm_vertical_crs: Annotated[
        str | None, Option("dsm-vertical", "Vertical CRS of the DSM (default: what its file says).")
    ] = None
    truth_accuracy: Annotated[
        float | None,
        Option(
            "truth-accuracy",
            "Standard error of the poses' positions in metres, such as the residuals of GCPs "
            "(default: what the source states, if it does).",
            least=0.001,
            most=100,
        ),
    ] = None
    protocol: Annotated[
        str, Option("protocol", "Retrieval protocol to start from, a name or .toml file.")
    ] = "photos-retrieval"
    matching_protocol: Annotated[
        str, Option("matching-protocol", "Matching protocol to start from, a name or .toml file.")
    ] = "photos-matching"
    reconstruction_protocol: Annotated[
        str,
        Option(
            "reconstruction-protocol",
            "Reconstruction protocol to start from, a name or .toml file.",
        ),
    ] = "photos-reconstruction"
    tile_size: Annotated[
        list[int] | None,
        Option("tile-size", "Side of a tile in map pixels; repeat it (default: the protocol's)."),
    ] = None
    tile_size_m: Annotated[
        list[float] | None,
        Option("tile-size-m", "Side of a tile in metres on the ground, instead; repeat it."),
    ] = None
    rule: Annotated[
        Literal["plane", "dsm", "iou"] | None,
        Option("rule", "When a tile is positive (default: the protocol's)."),
    ] = None
    iou_above: Annotated[float | None, Option("iou-above", "With --rule iou.")] = None


@dataclass(frozen=True, kw_only=True)
class SurveyOptions(SceneOptions, SourceOptions):
    """What every survey of another program asks for."""

    source: Annotated[Path, Option("source", "What the other program left: a folder or a file.")]
    name: Annotated[
        str | None, Option("name", "Of the benchmark and its scene (default: the source's).")
    ] = None
    images: Annotated[
        Path | None, Option("images", "Folder of the photos (default: where the source has them).")
    ] = None
    dom: Annotated[
        Path | None, Option("dom", "Map that tiles are cut from, GeoTIFF in any CRS.")
    ] = None


OptionsT = TypeVar("OptionsT", bound=SceneOptions)


class Survey(Dataset[OptionsT]):
    """One scene of own photos, whose protocols start from those of own photos.

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
                expected="letters, digits, '.', '_' and '-', beginning with a letter or digit, at "
                f"most {_LONGEST_NAME} characters",
                fix="name it with --name",
            )
        return str(name)

    def scenes(self, options: Any) -> Mapping[str, Sequence[Path]]:
        """Return the one scene, called like the benchmark, if all that it needs was given."""
        lacking = [field for field in self.needs if getattr(options, field) is None]
        if lacking:
            raise UsageError(f"--{lacking[0]} must be given")
        if self.needs_ground and options.dsm is None and options.plane_height is None:
            raise UsageError(
                "the height of the ground is not known",
                expected="a surface model (--dsm), or the ground as a plane (--plane-height)",
            )
        return {self.benchmark(options): path_options(options)}

    def map_of(self, options: Any) -> Path | None:
        """Return the map that tiles are cut from."""
        dom: Path | None = options.dom
        return dom

    def benchmark_protocols(self, options: Any, root: Path) -> BenchmarkProtocols:
        """Return the protocols of own photos, as changed by the options."""
        name = self.benchmark(options)
        retrieval = protocol_of_track(options.protocol, root, RetrievalProtocol)
        matching = protocol_of_track(options.matching_protocol, root, MatchingProtocol)
        reconstruction = protocol_of_track(
            options.reconstruction_protocol, root, ReconstructionProtocol
        )
        truth, sizes = retrieval.map_rules()[1], self._tile_sizes_px(options)
        rule, above = options.rule or truth.rule, options.iou_above
        if above is None and rule == "iou":
            above = truth.iou_above
        changes: dict[str, dict[str, Any]] = {
            "gallery": {"tile_sizes_px": sizes} if sizes else {},
            "ground_truth": {"rule": rule, "iou_above": above},
        }
        return BenchmarkProtocols(
            (
                protocol_for(retrieval, name, changes),
                protocol_for(matching, name, {}),
                protocol_for(reconstruction, name, {}),
            )
        )

    def prepare(self, options: OptionsT, settings: PrepareSettings) -> Prepared:
        """Make the folder, and say which sides tiles have that were asked for in metres."""
        for side, size in zip(
            options.tile_size_m or (), self._tile_sizes_px(options), strict=False
        ):
            settings.note(
                f"tiles of {side:g} m are {size} px of the map, at {self._pixel_m(options):.4g} m "
                "per pixel"
            )
        return super().prepare(options, settings)

    def _tile_sizes_px(self, options: SceneOptions) -> tuple[int, ...]:
        """Return the sides of tiles that were asked for, in pixels of the map; none by default."""
        if not options.tile_size_m:
            return tuple(options.tile_size or ())
        if options.tile_size:
            raise UsageError("--tile-size and --tile-size-m are both given", fix="give one of them")
        pixel = self._pixel_m(options)
        sizes = tuple(round(max(side, 0.0) / pixel) for side in options.tile_size_m)
        if min(sizes) < 1:
            raise UsageError(
                f"--tile-size-m {min(options.tile_size_m):g} is less than a pixel of the map",
                expected=f"more than {pixel:.3g} m",
            )
        return sizes

    def _pixel_m(self, options: SceneOptions) -> float:
        dom = self.map_of(options)
        if dom is None:
            raise UsageError("--tile-size-m needs a map", fix="give --dom, or --tile-size")
        return math.sqrt(math.prod(gsd_m(open_info(dom))))


def stated_crs(options: SceneOptions) -> CRS | None:
    """Return the CRS that ``--crs`` states, which must be projected and in metres."""
    return None if options.crs is None else metric_crs(options.crs, f"--crs {options.crs}")


def map_crs(dsm: Path | None, dom: Path | None) -> CRS:
    """Return the projected CRS of the surface model, or of the map where there is none."""
    path = dsm or dom
    if path is None:
        raise UsageError("no map is given", fix="give --dom and --dsm")
    crs = horizontal_crs(open_info(path).crs)
    if not crs.is_projected:
        raise CameraError(
            f"is in {describe_crs(crs)}, in which poses have no metres",
            where=path,
            fix="give --crs, such as the UTM zone",
        )
    return crs


@dataclass(frozen=True, eq=False)
class FoundPhotos:
    """Photos and their poses as a source has them.

    `sizes` are of every photo below `images`. `poses_from` and `crs_from` are for messages;
    `accuracy_m` is the standard error of the positions, as the source has it.
    """

    images: Path
    sizes: Mapping[str, tuple[int, int]]
    photos: PosedPhotos
    poses_from: Path
    dom: Path | None
    dsm: Path | None
    notes: tuple[str, ...] = ()
    accuracy_m: float | None = None
    crs_from: str = ""


def posed_scene(
    options: SceneOptions, scene: str, found: FoundPhotos, progress: Progress
) -> NativeScene:
    """Make the scene, its priors from the photos' metadata and ``--priors``."""
    photos = found.photos
    check_names(photos.names, found.images)
    check_centred(photos, found.poses_from)
    stated = options.crs or photos.crs or ""
    place = f"--crs {options.crs}" if options.crs else found.crs_from or str(found.poses_from)
    crs, dsm_vertical = metric_crs(stated, place).to_string(), options.dsm_vertical_crs
    centres, notes = surface_centres(
        photos.poses.centres, stated, crs, options.vertical_crs, found.dsm, dsm_vertical, place
    )
    metadata = photo_metadata(photos.names, found.images, options.priors, found.sizes, progress)
    metadata, more = surface_altitudes(
        metadata, options.priors_vertical_crs, "--priors-vertical", found.dsm, dsm_vertical
    )
    return NativeScene(
        scene,
        found.images,
        photos.names,
        photos.cameras,
        replace(photos.poses, centres=centres),
        crs,
        dom=found.dom,
        dsm=found.dsm,
        cloud=options.cloud,
        plane_height_m=options.plane_height,
        priors=metadata_priors(metadata, crs),
        metadata=metadata,
        unposed=tuple(sorted(set(found.sizes) - set(photos.names))),
        notes=(*found.notes, *notes, *more),
        truth_accuracy_m=options.truth_accuracy or found.accuracy_m,
        poses_from=found.poses_from,
        crs_from=place,
    )
