"""A row for each layout that readers read: inputs of the goldens, from one noisy truth a track."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import airzoo_bench as ab
from tests.goldens.run import unpack
from tests.matching.world import World as Hills
from tests.matching.world import make_world as make_hills

PHOTOS = {
    "yard": [f"yard_{row}.jpg" for row in range(6)],
    "lot": [f"lot_{row}.jpg" for row in range(4)],
}


@dataclass(frozen=True)
class Layout:
    """Files of a reader: a path among the goldens' inputs of its track, changed or not.

    They score as those of the layout `like`, up to a tolerance.
    """

    track: str
    source: str
    like: str = ""
    tolerance: float = 1e-8
    change: Callable[[Path], object] | None = None
    is_listed: bool = False  # names.txt beside it names its rows
    is_named: bool = False  # its files name the views
    is_pickled: bool = False
    needs_track: bool = False  # several tracks have such files


def change_fields(path: Path, **changes: Any) -> None:
    """Change fields of an npz, or leave them out where None."""
    with np.load(path, allow_pickle=True) as stored:
        found = dict(stored) | changes
    np.savez(path, **{name: one for name, one in found.items() if one is not None})


def change_scenes(file: str, **changes: Any) -> Callable[[Path], object]:
    return lambda path: [change_fields(path / one / file, **changes) for one in PHOTOS]


def _export_npz(path: Path) -> None:
    for scene in PHOTOS:
        (path / scene / "exports" / "mini_npz").rename(path / scene / "exports" / "npz")


_ranks = partial(Layout, "retrieval", like="trec", tolerance=0.0)
_matches = partial(Layout, "matching", like="aerialextrematch")
_poses = partial(Layout, "matching", like="hloc-poses", needs_track=True)
_pickle = partial(Layout, "matching", is_pickled=True)
# The points and poses of a trajectory are read as they are: it has no pixels, maps or masks.
_views = partial(Layout, "reconstruction", like="cloud-trajectory", tolerance=1e-4)  # float32
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
    "vggt": _views("vggt"),
    "vggt points": _views(
        "vggt", change=change_scenes("predictions.npz", depth=None, depth_conf=None)
    ),
    "vggt-colmap": _views("vggt-colmap", is_named=True),
    "vggt-slam": _views("vggt-slam", is_listed=True),
    "mapanything": _views("mapanything"),
    "mapanything colmap": _views("mapanything-colmap", is_named=True),
    "depth-anything-3": _views("depth-anything-3"),
    "depth-anything-3 npz": _views("depth-anything-3", change=_export_npz),
    "depth-anything-3 streaming": _views("depth-anything-3-streaming"),
    "depth-anything-3 colmap": _views("depth-anything-3-colmap", is_named=True),
    "cut3r": _views("cut3r"),
    "dust3r": _views("dust3r", is_named=True),
    "dust3r nameless": _views("dust3r", change=change_scenes("scene.npz", names=None)),
    "cloud-trajectory": _views("cloud-trajectory"),
    "cloud-trajectory kitti": _views("cloud-trajectory-kitti"),
}


@dataclass(frozen=True)
class Worlds:
    """The inputs of the goldens with their benchmarks, and the made world of matching."""

    hills: Hills
    home: Path
    kept: dict[str, ab.Result] = field(default_factory=dict)

    @classmethod
    def make(cls, home: Path) -> Worlds:
        for track in ("retrieval", "reconstruction"):
            unpack(f"readers-{track}", home / track)
        return cls(make_hills(home / "matching"), home)

    def sample(self, name: str, folder: Path) -> Path:
        """Put the files of a layout into a new folder; those of views beside a list of photos."""
        one = LAYOUTS[name]
        top, _, below = one.source.partition("/")
        target = folder if below else folder / "out"
        path = Path(shutil.copytree(self.home / one.track / top, target)) / below
        if one.change:
            one.change(path)
        if one.track == "reconstruction":
            names = [f"{scene}/{name}" for scene, photos in PHOTOS.items() for name in photos]
            (folder / "names.txt").write_text("\n".join(names))
        return path

    def evaluate(self, track: str, path: Path, **options: Any) -> ab.Result:
        data = self.home / track / "data"
        name = "hills" if track == "matching" else "made"
        return ab.evaluate(
            path, **{"protocol": f"{name}-{track}", "data": data, "jobs": 1} | options
        )

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
