"""Tables of tracks, datasets and readers by name, and options of the command line.

Modules are imported when they are chosen; packages add theirs by an entry point of the group.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any


@dataclass(frozen=True)
class Option:
    """An option of the command line, as an annotation of a field of a dataclass of settings.

    ``pixels: Annotated[int, Option("pixels", "Of the longer side.", least=64)] = 640`` is
    ``--pixels``; without a default it must be given, and ``--no-`` turns a bool off.
    """

    name: str
    help: str
    least: float | None = None
    most: float | None = None


def resolve(place: str) -> Any:
    """Import ``module:name``, such as "airzoo_bench.retrieval.info:INFO"."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


class Registry:
    """Places ``module:name`` by name: built in, or of installed packages."""

    def __init__(self, group: str, places: Mapping[str, str]) -> None:
        self.group, self.places = group, dict(places)

    def __contains__(self, name: str) -> bool:
        return name in self.places or name in _installed(self.group, tuple(sys.path))

    def names(self) -> list[str]:
        """Return all names: built-in first, in their own order, then others by name."""
        return [*self.places, *sorted(_installed(self.group, tuple(sys.path)).keys() - self.places)]

    def get(self, name: str) -> Any:
        """Import the object of a name, a built-in one first; raise KeyError for an unknown one."""
        if name in self.places:
            return resolve(self.places[name])
        return _installed(self.group, tuple(sys.path))[name].load()


@cache
def _installed(group: str, _: tuple[str, ...]) -> dict[str, EntryPoint]:
    """Return what other packages add to a group, searched once for each search path."""
    return {point.name: point for point in entry_points(group=group)}


TRACKS = Registry(
    "airzoo_bench.tracks",
    {
        "retrieval": "airzoo_bench.retrieval.info:INFO",
        "matching": "airzoo_bench.matching.info:INFO",
        "reconstruction": "airzoo_bench.reconstruction.info:INFO",
    },
)
"""Tracks by name, each a `airzoo_bench.evaluation.info.TrackInfo`."""


def load_track(name: str) -> Any:
    """Import the `airzoo_bench.evaluation.track.Track` of a name."""
    return resolve(TRACKS.get(name).track)


DATASETS = Registry(
    "airzoo_bench.datasets",
    {
        "photos": "airzoo_bench.datasets.surveys.survey:PHOTOS",
        "airzoo-mini": "airzoo_bench.datasets.mini.dataset:AIRZOO_MINI",
        "poses": "airzoo_bench.datasets.surveys.pose_table:POSES",
        "odm": "airzoo_bench.datasets.surveys.odm:ODM",
        "dji": "airzoo_bench.datasets.surveys.dji:DJI",
        "colmap": "airzoo_bench.datasets.surveys.colmap:COLMAP",
        "uav-visloc": "airzoo_bench.datasets.published.uav_visloc:UAV_VISLOC",
        "uavscenes": "airzoo_bench.datasets.published.scans:UAVSCENES",
        "urbanscene3d": "airzoo_bench.datasets.published.scans:URBANSCENE3D",
        "airzoo-test": "airzoo_bench.datasets.published.airzoo_test:AIRZOO_TEST",
        "airzoo-real": "airzoo_bench.datasets.published.airzoo_real:AIRZOO_REAL",
        "aerialextrematch": "airzoo_bench.datasets.published.localisation:AERIALEXTREMATCH",
        "ortholoc": "airzoo_bench.datasets.published.localisation:ORTHOLOC",
        "university-1652": "airzoo_bench.datasets.published.image_pairs:UNIVERSITY_1652",
        "sues-200": "airzoo_bench.datasets.published.image_pairs:SUES_200",
        "denseuav": "airzoo_bench.datasets.published.image_pairs:DENSEUAV",
        "gta-uav": "airzoo_bench.datasets.published.image_pairs:GTA_UAV",
    },
)
"""What `prepare` makes benchmark folders of, by name, each a `datasets.dataset.Dataset`."""

READERS = Registry(
    "airzoo_bench.readers",
    {
        "vpr": "airzoo_bench.readers.vpr:VPR",
        "anyloc": "airzoo_bench.readers.descriptors:ANYLOC",
        "hloc-global": "airzoo_bench.readers.descriptors:HLOC_GLOBAL",
        "game4loc": "airzoo_bench.readers.descriptors:GAME4LOC",
        "university1652": "airzoo_bench.readers.descriptors:UNIVERSITY1652",
        "trec": "airzoo_bench.readers.ranks:TREC",
        "hloc": "airzoo_bench.readers.hloc:HLOC",
        "hloc-poses": "airzoo_bench.readers.poses:HLOC_POSES",
        "loftr": "airzoo_bench.readers.pairs:LOFTR",
        "superglue": "airzoo_bench.readers.pairs:SUPERGLUE",
        "roma": "airzoo_bench.readers.pairs:ROMA",
        "dust3r-matches": "airzoo_bench.readers.pairs:DUST3R_MATCHES",
        "mast3r-visloc": "airzoo_bench.readers.pairs:MAST3R_VISLOC",
        "aerialextrematch": "airzoo_bench.readers.pairs:AERIALEXTREMATCH",
        "vismatch": "airzoo_bench.readers.pairs:VISMATCH",
        "loftr-dump": "airzoo_bench.readers.pairs:LOFTR_DUMP",
        "hloc-logs": "airzoo_bench.readers.pairs:HLOC_LOGS",
        "colmap-poses": "airzoo_bench.readers.poses:COLMAP_POSES",
        "tum": "airzoo_bench.readers.poses:TUM_POSES",
        "kitti": "airzoo_bench.readers.poses:KITTI_POSES",
        "cloud-trajectory": "airzoo_bench.readers.frames:CLOUD_TRAJECTORY",
        "cut3r": "airzoo_bench.readers.frames:CUT3R",
        "depth-anything-3": "airzoo_bench.readers.reconstructions:DEPTH_ANYTHING_3",
        "dust3r": "airzoo_bench.readers.reconstructions:DUST3R",
        "mapanything": "airzoo_bench.readers.reconstructions:MAPANYTHING",
        "vggt": "airzoo_bench.readers.reconstructions:VGGT",
        "vggt-colmap": "airzoo_bench.readers.reconstructions:VGGT_COLMAP",
        "vggt-slam": "airzoo_bench.readers.frames:VGGT_SLAM",
    },
)
"""What reads files as methods write them, by name, each an `evaluation.reader.Reader`."""
