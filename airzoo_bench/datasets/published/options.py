"""What published benchmarks ask for beyond their folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from airzoo_bench.core.registry import Option
from airzoo_bench.datasets.native import NativeOptions

__all__ = [
    "AIRZOO_TEST_NAME",
    "AerialExtreMatchOptions",
    "AirZooRealOptions",
    "AirZooTestOptions",
    "Heading",
    "UavScenesOptions",
    "UavVisLocOptions",
    "UrbanScene3DOptions",
]

AIRZOO_TEST_NAME = "airzoo-test"

Heading = Literal["compass", "east-north-positive", "counter-clockwise"]


@dataclass(frozen=True)
class AerialExtreMatchOptions(NativeOptions):
    """What differs from the protocol that the paper follows."""

    reference: Annotated[
        Literal["hq", "lq"],
        Option("reference", "Map and surface model of high (HQref) or low quality (LQref)."),
    ] = "hq"
    prior: Annotated[
        Literal["metadata", "truth"],
        Option(
            "prior",
            "Crop by the photos' own GPS and gimbal angles, or by the truth, as the benchmark's "
            "own configuration does: that is another benchmark, and named so.",
        ),
    ] = "metadata"
    priors: Annotated[
        Path | None,
        Option("priors", "CSV of positions and gimbal angles, where photos' metadata lack them."),
    ] = None


@dataclass(frozen=True)
class AirZooRealOptions(NativeOptions):
    """What the release does not state, and files that are not told by their kind."""

    dom: Annotated[
        list[str] | None, Option("dom", "SCENE=FILE: the map that photos are matched to.")
    ] = None
    dsm: Annotated[list[str] | None, Option("dsm", "SCENE=FILE: the surface model.")] = None
    satellite: Annotated[
        list[str] | None, Option("satellite", "SCENE=FILE: the map of retrieval, of 0.3 m a pixel.")
    ] = None
    positions: Annotated[
        list[str] | None,
        Option("positions", "SCENE=FILE: CSV of true positions (image, lon, lat, altitude_m)."),
    ] = None
    priors: Annotated[
        list[str] | None,
        Option("priors", "SCENE=FILE: CSV of priors, where photos' metadata lack them."),
    ] = None
    prior: Annotated[
        Literal["metadata", "truth"],
        Option(
            "prior",
            "Crop by the photos' own metadata, or by the truth: that is another benchmark, of "
            "matching alone, and named so.",
        ),
    ] = "metadata"
    camera: Annotated[
        list[str] | None,
        Option("camera", "SCENE=FILE: camera (JSON), where metadata state none."),
    ] = None
    height_offset: Annotated[
        list[str] | None,
        Option("height-offset", "SCENE=METRES to add to heights of truth and priors (default: 0)."),
    ] = None
    cloud: Annotated[
        list[str] | None,
        Option("cloud", "SCENE=FILE: true cloud of a site, such as school or school-06-08."),
    ] = None
    truth_reach: Annotated[
        float,
        Option(
            "truth-reach",
            "Metres around the cameras within which the surface model is the true cloud.",
            least=1,
            most=5000,
        ),
    ] = 500.0


@dataclass(frozen=True)
class AirZooTestOptions(NativeOptions):
    """Which frames are reconstructed, and how depth is encoded."""

    name: Annotated[
        str,
        Option("name", "Of the benchmark; another name takes any number of trajectories."),
    ] = AIRZOO_TEST_NAME
    every: Annotated[
        int,
        Option("every", "Take every Nth frame of a trajectory, starting with the first.", least=1),
    ] = 30
    depth_kind: Annotated[
        Literal["z", "ray"],
        Option("depth-kind", "Depth along the optical axis, or from the camera along the ray."),
    ] = "z"
    depth_scale: Annotated[
        float | None, Option("depth-scale", "Metres of a unit of depth, where it is not metres.")
    ] = None
    clouds: Annotated[
        Path | None,
        Option("clouds", "Folder to keep the true clouds in (default: one in the data root)."),
    ] = None


@dataclass(frozen=True)
class UavVisLocOptions(NativeOptions):
    """What UAV-VisLoc does not state, and where its folder is."""

    heading: Annotated[
        Heading,
        Option(
            "heading",
            "What its angle is: compass, clockwise from north; east-north-positive, as its table "
            "has it; or counter-clockwise from north.",
        ),
    ] = "compass"
    heading_column: Annotated[
        Literal["Phi1", "Phi2"], Option("heading-column", "Which of its two headings is taken.")
    ] = "Phi1"
    missing_heading: Annotated[
        str,
        Option(
            "missing-heading",
            "What photos without a heading get, as all of flight 07: flight-table (the flight's "
            "Phi in UAV-VisLoc's own table) or degrees; or leave-out.",
        ),
    ] = "flight-table"
    fov_across: Annotated[
        float,
        Option(
            "fov-across",
            "Degrees that a photo's width sees, across the heading.",
            least=1,
            most=170,
        ),
    ] = 52.0
    fov_along: Annotated[
        float,
        Option(
            "fov-along", "Degrees that a photo's height sees, along the heading.", least=1, most=170
        ),
    ] = 36.0
    plane_height: Annotated[
        list[str] | None,
        Option(
            "plane-height",
            "Height of the ground in the datum of the photos' heights: METRES, or FLIGHT=METRES, "
            "repeated (default: 0, as for heights above the ground).",
        ),
    ] = None
    height_above_ground: Annotated[
        float,
        Option(
            "height-above-ground",
            "Median height above the ground, in metres, assumed for flights whose heights vary as "
            "heights above sea level do, where --plane-height says nothing.",
            least=1,
            most=10_000,
        ),
    ] = 500.0
    joined_maps: Annotated[
        Path | None,
        Option(
            "joined-maps",
            "Folder for the virtual map over the tiles of flight 09 (default: where they lie).",
        ),
    ] = None
    protocol: Annotated[
        str, Option("protocol", "Retrieval protocol to make the truth for, a name or .toml file.")
    ] = "uav-visloc-retrieval"


@dataclass(frozen=True)
class UavScenesOptions(NativeOptions):
    """Which photos of a run are reconstructed, and what its files do not settle."""

    interval: Annotated[
        int, Option("interval", "Take the photos of interval5_... or interval1_...", least=1)
    ] = 5
    every: Annotated[
        int, Option("every", "Take every Nth photo of a run, starting with the first.", least=1)
    ] = 10
    cloud: Annotated[
        list[str] | None,
        Option(
            "cloud", "True cloud of a run, as RUN=FILE; repeat it (default: that of its place)."
        ),
    ] = None
    lens: Annotated[
        Literal["file", "none"],
        Option("lens", "Lens distortion as the poses' file states it, or none."),
    ] = "file"


@dataclass(frozen=True)
class UrbanScene3DOptions(NativeOptions):
    """Scans, and how the frame of the poses leads to theirs."""

    scan: Annotated[
        list[str] | None,
        Option("scan", "Scan of a scene, PLY, LAS or LAZ, as SCENE=FILE; repeat it."),
    ] = None
    transform: Annotated[
        list[str] | None,
        Option(
            "transform",
            "4 x 4 matrix from the frame of a scene's poses to that of its scan, as SCENE=FILE; "
            "repeat it.",
        ),
    ] = None
    same_frame: Annotated[
        bool, Option("same-frame", "Poses without a transform are in the frame of the scan.")
    ] = False
    every: Annotated[
        int, Option("every", "Take every Nth photo of a scene, starting with the first.", least=1)
    ] = 1
