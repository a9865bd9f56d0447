"""A row for each layout that readers read, and the made worlds whose truth its files come from.

Files of retrieval and matching are the inputs of the goldens, written from one noisy truth for each
track; those of reconstruction are written from true views.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import airzoo_bench as ab
from tests.goldens.run import unpack
from tests.matching.world import World as Hills
from tests.matching.world import make_world as make_hills
from tests.readers.method_files import (
    WRITERS,
    Place,
    made_scenes,
    make_views_world,
    write_descriptors,
    write_log,
)
from tests.reconstruction.world import World as Views


@dataclass(frozen=True)
class Layout:
    """Files of a reader, made by `source`: a path among the goldens' inputs, or a writer.

    They score as those of the layout `like` up to a tolerance; where that is None, perfectly.
    """

    track: str
    source: str | Callable[..., Path]
    like: str | None = None
    tolerance: float = 1e-8
    is_listed: bool = False  # names.txt beside it names its rows
    is_named: bool = False  # its files name the views
    is_pickled: bool = False
    needs_track: bool = False  # several tracks have such files


_ranks = partial(Layout, "retrieval", like="trec", tolerance=0.0)
_matches = partial(Layout, "matching", like="aerialextrematch")
_poses = partial(Layout, "matching", like="hloc-poses", needs_track=True)
_pickle = partial(Layout, "matching", is_pickled=True)
_views = partial(Layout, "reconstruction", tolerance=1e-4)
# By name, whose first word is the reader's.
LAYOUTS = {
    "vpr": _ranks("vpr/logs"),
    "anyloc": _ranks("anyloc/anyloc"),
    "hloc-global": _ranks("hloc-global/global-feats-netvlad.h5"),
    "game4loc": _ranks("game4loc/features.npz"),
    "university1652": _ranks("university1652/pytorch_result.mat"),
    "trec": _ranks("trec/mine.run"),
    "loftr": _matches("loftr/loftr"),
    "superglue": _matches("superglue/superglue"),
    "roma": _matches("roma/roma"),
    "dust3r-matches": _matches("dust3r/dust3r"),
    "mast3r-visloc": _matches("mast3r-visloc/matches/tol_5"),
    "aerialextrematch": _matches("aerialextrematch/aerialextrematch"),
    "hloc": _matches("hloc/files", tolerance=1e-4),  # float32
    "hloc dense": _matches("hloc-dense/matches-loftr.h5"),
    "vismatch": _pickle("vismatch/outputs/sift-lightglue"),
    "loftr-dump": _pickle("loftr-dump/LoFTR_pred_eval.npy"),
    "hloc-logs": _pickle("hloc-logs/results.txt_logs.pkl"),
    "hloc-poses": _poses("hloc-poses/hloc_results.txt", needs_track=False),
    "tum": _poses("tum/tum.txt", is_listed=True),
    "kitti": _poses("kitti/kitti.txt", is_listed=True),
    "colmap-poses": _poses("colmap-poses/colmap"),
    "vggt": _views(WRITERS["vggt"]),
    "vggt points": _views(partial(WRITERS["vggt"], depth=None, depth_conf=None)),
    "vggt-colmap": _views(WRITERS["vggt_colmap"], is_named=True),
    "vggt-slam": _views(WRITERS["vggt_slam"], is_listed=True, tolerance=1e-3),
    "mapanything": _views(WRITERS["mapanything"]),
    "mapanything colmap": _views(WRITERS["mapanything_colmap"], is_named=True),
    "depth-anything-3": _views(WRITERS["da3"]),
    "depth-anything-3 npz": _views(partial(WRITERS["da3"], kind="npz")),
    "depth-anything-3 streaming": _views(WRITERS["da3_streaming"]),
    "depth-anything-3 colmap": _views(WRITERS["da3_colmap"], is_named=True),
    "cut3r": _views(WRITERS["cut3r"]),
    "dust3r": _views(WRITERS["dust3r"], is_named=True),
    "dust3r nameless": _views(partial(WRITERS["dust3r"], names=None)),
    "cloud-trajectory": _views(WRITERS["cloud_trajectory"]),
    "cloud-trajectory kitti": _views(partial(WRITERS["cloud_trajectory"], kitti=True)),
}


@dataclass(frozen=True)
class Worlds:
    """The made worlds of the tracks, and the folder of the goldens' inputs."""

    hills: Hills
    views: Views
    home: Path
    roots: dict[str, Path]
    kept: dict[str, ab.Result] = field(default_factory=dict)

    @classmethod
    def make(cls, home: Path) -> Worlds:
        hills, views = make_hills(home / "hills"), make_views_world(home / "views")
        for track in ("retrieval", "matching"):
            unpack(f"readers-{track}", home / track)
        roots = {"retrieval": Place().prepare(home / "data"), "matching": hills.root}
        return cls(hills, views, home, roots | {"reconstruction": views.root})

    def sample(self, name: str, folder: Path, **options: Any) -> Path:
        """Put the files of a layout into a new folder."""
        one = LAYOUTS[name]
        if not isinstance(one.source, str):
            return one.source(folder, self.views, **options)
        top, _, below = one.source.partition("/")
        return Path(shutil.copytree(self.home / one.track / top, folder)) / below

    def evaluate(self, track: str, path: Path, **options: Any) -> ab.Result:
        name = "hills" if track == "matching" else "made"
        given = {"protocol": f"{name}-{track}", "data": self.roots[track], "jobs": 1}
        return ab.evaluate(path, **given | options)

    def score(self, name: str) -> ab.Result:
        """Return the result of a sound sample, which is scored once."""
        if name not in self.kept:
            path = self.sample(name, self.home / "samples" / name)
            names = path.parent / "names.txt" if LAYOUTS[name].is_listed else None
            self.kept[name] = self.evaluate(LAYOUTS[name].track, path, names=names)
        return self.kept[name]


@pytest.fixture(scope="session")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> Worlds:
    return Worlds.make(tmp_path_factory.mktemp("worlds"))


@pytest.fixture
def retrieved(worlds: Worlds) -> Callable[..., Any]:
    """Return a function that scores a path of the retrieval track."""
    return partial(worlds.evaluate, "retrieval")


@pytest.fixture
def matched(worlds: Worlds) -> Callable[..., Any]:
    return partial(worlds.evaluate, "matching")


@pytest.fixture
def reconstructed(worlds: Worlds) -> Callable[..., Any]:
    return partial(worlds.evaluate, "reconstruction")


@pytest.fixture
def one(tmp_path: Path) -> Path:
    """Return the data root of a benchmark of one scene."""
    return Place(made_scenes()[:1]).prepare(tmp_path / "data")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Return a log folder for one scene, whose images are not on this machine."""
    write_log(tmp_path / "log", made_scenes()[0])
    write_descriptors(tmp_path / "log", Place(made_scenes()[:1]), made_scenes()[0])
    return tmp_path / "log"
