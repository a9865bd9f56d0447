"""A row for each layout that readers read: where its files are, and what is special.

Files of retrieval and matching are the inputs of the goldens, written from one noisy truth for each
track; those of reconstruction are written from true views.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import airzoo_bench as ab
from tests.goldens.run import unpack
from tests.matching.world import World as Hills
from tests.matching.world import make_world as make_hills
from tests.readers.retrieval_files import Place
from tests.readers.scene_files import WRITERS, make_views_world
from tests.reconstruction.world import World as Views

# By layout, whose first word is the reader's name.
RETRIEVAL = {
    "vpr": "vpr/logs",
    "anyloc": "anyloc/anyloc",
    "hloc-global": "hloc-global/global-feats-netvlad.h5",
    "game4loc": "game4loc/features.npz",
    "university1652": "university1652/pytorch_result.mat",
    "trec": "trec/mine.run",
}
MATCHING = {
    "loftr": "loftr/loftr",
    "superglue": "superglue/superglue",
    "roma": "roma/roma",
    "dust3r-matches": "dust3r/dust3r",
    "mast3r-visloc": "mast3r-visloc/matches/tol_5",
    "aerialextrematch": "aerialextrematch/aerialextrematch",
    "hloc": "hloc/files",
    "hloc dense": "hloc-dense/matches-loftr.h5",
    "vismatch": "vismatch/outputs/sift-lightglue",
    "loftr-dump": "loftr-dump/LoFTR_pred_eval.npy",
    "hloc-logs": "hloc-logs/results.txt_logs.pkl",
    "hloc-poses": "hloc-poses/hloc_results.txt",
    "tum": "tum/tum.txt",
    "kitti": "kitti/kitti.txt",
    "colmap-poses": "colmap-poses/colmap",
}
RECONSTRUCTION: dict[str, Callable[..., Path]] = {
    "vggt": WRITERS["vggt"],
    "vggt points": partial(WRITERS["vggt"], depth=None, depth_conf=None),
    "vggt-colmap": WRITERS["vggt_colmap"],
    "vggt-slam": WRITERS["vggt_slam"],
    "mapanything": WRITERS["mapanything"],
    "mapanything colmap": WRITERS["mapanything_colmap"],
    "depth-anything-3": WRITERS["da3"],
    "depth-anything-3 npz": partial(WRITERS["da3"], kind="npz"),
    "depth-anything-3 streaming": WRITERS["da3_streaming"],
    "depth-anything-3 colmap": WRITERS["da3_colmap"],
    "cut3r": WRITERS["cut3r"],
    "dust3r": WRITERS["dust3r"],
    "dust3r nameless": partial(WRITERS["dust3r"], names=None),
    "cloud-trajectory": WRITERS["cloud_trajectory"],
    "cloud-trajectory kitti": partial(WRITERS["cloud_trajectory"], kitti=True),
}
TRACKS = dict.fromkeys(RETRIEVAL, "retrieval") | dict.fromkeys(MATCHING, "matching")
TRACKS |= dict.fromkeys(RECONSTRUCTION, "reconstruction")
PICKLES = ("vismatch", "loftr-dump", "hloc-logs")
POSES = ("hloc-poses", "tum", "kitti", "colmap-poses")
AMBIGUOUS = POSES[1:]  # found once the track is known
LISTED = ("tum", "kitti", "vggt-slam")  # with names.txt beside the files
NAMED = ("dust3r", "vggt-colmap", "mapanything colmap", "depth-anything-3 colmap")  # by its files


@dataclass(frozen=True)
class Worlds:
    """The made worlds of the tracks, and the folder of the goldens' inputs."""

    hills: Hills
    views: Views
    home: Path
    roots: dict[str, Path]

    @classmethod
    def make(cls, home: Path) -> Worlds:
        hills, views = make_hills(home / "hills"), make_views_world(home / "views")
        for track in ("retrieval", "matching"):
            unpack(f"readers-{track}", home / track)
        roots = {"retrieval": Place().prepare(home / "data"), "matching": hills.root}
        return cls(hills, views, home, roots | {"reconstruction": views.root})

    def sample(self, name: str, folder: Path, **options: Any) -> Path:
        """Put the files of a layout into a new folder."""
        if name in RECONSTRUCTION:
            return RECONSTRUCTION[name](folder, self.views, **options)
        top, _, below = (RETRIEVAL | MATCHING)[name].partition("/")
        return Path(shutil.copytree(self.home / TRACKS[name] / top, folder)) / below

    def evaluate(self, track: str, path: Path, **options: Any) -> ab.Result:
        name = "hills" if track == "matching" else "made"
        given = {"protocol": f"{name}-{track}", "data": self.roots[track], "jobs": 1}
        return ab.evaluate(path, **given | options)
