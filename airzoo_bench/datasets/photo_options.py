"""What `prepare photos` asks for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from airzoo_bench.core.registry import Option

__all__ = ["HeightOptions", "PhotoOptions", "ProtocolOptions", "Rule", "SceneOptions"]

Rule = Literal["plane", "dsm", "iou"]


@dataclass(frozen=True, kw_only=True)
class ProtocolOptions:
    """What differs from the protocols to start from."""

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
        Rule | None, Option("rule", "When a tile is positive (default: the protocol's).")
    ] = None
    iou_above: Annotated[float | None, Option("iou-above", "With --rule iou.")] = None


@dataclass(frozen=True, kw_only=True)
class HeightOptions:
    """What heights are above, and how well the truth is known."""

    vertical_crs: Annotated[
        str | None,
        Option(
            "vertical-crs",
            "Vertical CRS of the poses, to convert heights to the DSM's, such as EPSG:4979 "
            "(ellipsoid) or EPSG:5773 (EGM96).",
        ),
    ] = None
    priors_vertical_crs: Annotated[
        str | None,
        Option("priors-vertical", "Vertical CRS of altitudes in metadata and --priors."),
    ] = None
    dsm_vertical_crs: Annotated[
        str | None,
        Option("dsm-vertical", "Vertical CRS of the DSM (default: what its file says)."),
    ] = None
    truth_accuracy: Annotated[
        float | None,
        Option(
            "truth-accuracy",
            "Standard error of the poses' positions in metres, such as the residuals of GCPs "
            "(default: what the source states, if it does).",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class SceneOptions(HeightOptions):
    """Where the further parts of a scene lie."""

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
            "priors",
            "CSV of positions and gimbal angles, where the photos' metadata lack them.",
        ),
    ] = None
    crs: Annotated[
        str | None, Option("crs", "CRS of the poses (default: what their file says).")
    ] = None
    plane_height: Annotated[
        float | None,
        Option(
            "plane-height",
            "Height of the ground as a plane, in the poses' vertical datum (default: the median "
            "of the surface model).",
        ),
    ] = None


@dataclass(frozen=True)
class PhotoOptions(ProtocolOptions, SceneOptions):
    """Where the parts of a scene lie, and what differs from the protocols to start from."""

    name: Annotated[str, Option("name", "Of the benchmark and its scene.")]
    images: Annotated[Path, Option("images", "Folder of the photos.")]
    poses: Annotated[Path, Option("poses", "Pose file (JSON), or folder of a COLMAP model.")]
    dom: Annotated[Path, Option("dom", "Map that tiles are cut from, GeoTIFF in any CRS.")]
