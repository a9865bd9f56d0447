"""What own surveys ask for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from airzoo_bench.core.registry import Option
from airzoo_bench.datasets.native import NativeOptions
from airzoo_bench.datasets.photo_options import ProtocolOptions, SceneOptions

__all__ = ["ColmapOptions", "DjiOptions", "OdmOptions", "PoseTableOptions", "SurveyOptions"]


@dataclass(frozen=True, kw_only=True)
class SurveyOptions(ProtocolOptions, SceneOptions, NativeOptions):
    """What every own survey asks for."""

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
    crs: Annotated[str | None, Option("crs", "Projected CRS of the poses.")] = None


@dataclass(frozen=True, kw_only=True)
class ColmapOptions(SurveyOptions):
    """What may be asked of a COLMAP model."""

    source: Annotated[Path, Option("source", "Folder of the model, such as sparse/0.")]
    georeference: Annotated[
        Path | None,
        Option(
            "georeference",
            "4 x 4 matrix from the model to the CRS, or lines of name, x, y, z (default: the "
            "model is in --crs already).",
        ),
    ] = None
    from_exif: Annotated[
        bool, Option("from-exif", "Bring the model to the positions that its photos state.")
    ] = False
    inlier_m: Annotated[
        float,
        Option("inlier-m", "Positions that fit to better than this place the model.", least=1e-3),
    ] = 5.0


@dataclass(frozen=True, kw_only=True)
class DjiOptions(SurveyOptions):
    """What may be asked of a folder of DJI photos."""

    source: Annotated[Path, Option("source", "Folder of the photos, and of *_Timestamp.MRK.")]
    priors: Annotated[
        Path | None,
        Option("priors", "CSV of positions and angles that are not the RTK's, for matching."),
    ] = None
    rtk: Annotated[
        Literal["fixed", "any"],
        Option("rtk", "Photos whose position becomes truth: those with an RTK fix, or any."),
    ] = "fixed"
    camera: Annotated[
        Path | None,
        Option("camera", "Camera of all photos (JSON); default: what the photos say."),
    ] = None


@dataclass(frozen=True, kw_only=True)
class OdmOptions(SurveyOptions):
    """What may be asked of an OpenDroneMap project."""

    source: Annotated[Path, Option("source", "The project's folder.")]
    surface_cell: Annotated[
        float | None,
        Option(
            "surface-cell",
            "Side in metres of the cells that the cloud is gridded by, where there is no surface "
            "model (default: what holds four points).",
            least=0.01,
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class PoseTableOptions(SurveyOptions):
    """What a table of poses leaves open."""

    source: Annotated[
        Path, Option("source", "Table of the photos' positions and angles, a row a photo.")
    ]
    camera: Annotated[
        Path | None,
        Option("camera", "Camera of all photos (JSON: fx, or focal_mm and sensor_mm, or fov_deg)."),
    ] = None
    angles: Annotated[
        Literal["gimbal", "airframe", "omega-phi-kappa"] | None,
        Option("angles", "What the angles mean (default: what the columns' names tell)."),
    ] = None
    angle_unit: Annotated[
        Literal["degrees", "radians"] | None, Option("angle-unit", "Default: degrees.")
    ] = None
    north: Annotated[
        Literal["true", "grid"] | None,
        Option("north", "What angles are relative to (default: yaw true north, kappa the grid's)."),
    ] = None
