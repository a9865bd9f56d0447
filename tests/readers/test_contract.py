"""What holds for every reader: exact files are perfect, in any order, and damage is no crash."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import airzoo_bench as ab
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.reader import SURE, find_reader
from tests.hostile.mutations import spoil_bytes
from tests.matching.world import World as Matching
from tests.readers import matching_files
from tests.readers import retrieval_files as files
from tests.readers.recon_support import check_perfect, row, scored, world
from tests.readers.retrieval_files import PROTOCOL, Place, perfect
from tests.readers.samples import (
    cloud_trajectory,
    cut3r,
    depth_anything_3,
    dust3r,
    mapanything,
    true_views,
    vggt,
    vggt_colmap,
    vggt_slam,
)
from tests.reconstruction.world import World

__all__ = ["world"]

Write = Callable[..., Path]
SPOILT = 3  # ways a file


@dataclass(frozen=True)
class Case:
    """Files of a reader, which is found for any track or for its own alone."""

    reader: str
    write: Write
    track: str | None = None
    listed: bool = False  # names are in a list beside it
    named: bool = False  # files name their views

    def make(self, folder: Path, source: Any) -> Path:
        if self not in VIEWS:
            folder.mkdir()
        return self.write(folder, source)


RETRIEVAL = [
    Case("vpr", files.write_vpr),
    Case("anyloc", files.write_anyloc),
    Case("hloc-global", files.write_hloc_global),
    Case("game4loc", files.write_game4loc),
    Case("university1652", files.write_university1652),
    Case("trec", files.write_trec),
]
EXACT = [
    *(Case("loftr", matching_files.write_loftr), Case("superglue", matching_files.write_superglue)),
    *(
        Case("roma", matching_files.write_roma),
        Case("roma", partial(matching_files.write_roma, pixels=True)),
    ),
    *(
        Case("dust3r-matches", matching_files.write_dust3r),
        Case("hloc", matching_files.write_hloc_dense),
    ),
    Case("mast3r-visloc", matching_files.write_mast3r_visloc),
    Case("aerialextrematch", matching_files.write_aerialextrematch),
    Case("hloc", partial(matching_files.write_hloc, dtype=np.float64)),
    Case("hloc", partial(matching_files.write_hloc, dtype=np.float64, swapped=True)),
    Case("hloc", partial(matching_files.write_hloc, dtype=np.float64, libver="earliest")),
]
POSES = [
    Case("hloc-poses", matching_files.write_hloc_poses),
    Case("tum", matching_files.write_tum, "matching", listed=True),
    Case("kitti", matching_files.write_kitti, "matching", listed=True),
    Case("colmap-poses", matching_files.write_colmap, "matching"),
    Case("colmap-poses", partial(matching_files.write_colmap, text=True), "matching"),
]
VIEWS = [
    *(Case("vggt", vggt.write), Case("mapanything", mapanything.write)),
    Case("vggt", partial(vggt.write, depth=None, depth_conf=None)),
    Case("depth-anything-3", depth_anything_3.write),
    Case("depth-anything-3", partial(depth_anything_3.write, kind="npz")),
    Case("depth-anything-3", depth_anything_3.write_streaming),
    *(Case("cut3r", cut3r.write), Case("dust3r", dust3r.write, named=True)),
    Case("dust3r", partial(dust3r.write, names=None)),
    Case("vggt-colmap", vggt_colmap.write, named=True),
    Case("mapanything", mapanything.write_models, named=True),
    Case("depth-anything-3", depth_anything_3.write_models, named=True),
    Case("vggt-slam", vggt_slam.write, listed=True),
    Case("cloud-trajectory", cloud_trajectory.write),
    Case("cloud-trajectory", cloud_trajectory.write_kitti),
]
REFUSED = [
    Case("vismatch", matching_files.write_vismatch),
    Case("loftr-dump", matching_files.write_loftr_dump),
    Case("hloc-logs", matching_files.write_hloc_logs),
]
ALL = [*RETRIEVAL, *EXACT, *POSES, *VIEWS, *REFUSED]


def label(case: Case) -> str:
    write = case.write
    given = getattr(write, "keywords", {})
    return " ".join([case.reader, getattr(write, "func", write).__name__, *map(str, given)])


def each(cases: list[Case]) -> Any:
    return pytest.mark.parametrize("case", cases, ids=label)


def test_every_reader_has_a_case() -> None:
    assert {case.reader for case in ALL} == set(READERS.names())


@pytest.fixture(scope="module")
def written(
    tmp_path_factory: pytest.TempPathFactory, matching_world: Matching, world: World
) -> dict[str, Path]:
    """Write all cases once."""
    found = {}
    for case in ALL:
        source: Any = Place() if case in RETRIEVAL else world if case in VIEWS else matching_world
        found[label(case)] = case.make(tmp_path_factory.mktemp("case") / "f", source)
    return found


@pytest.fixture(scope="module")
def matching_world(tmp_path_factory: pytest.TempPathFactory) -> Matching:
    from tests.matching.world import make_world

    return make_world(tmp_path_factory.mktemp("matching"))


@each(ALL)
def test_files_are_of_their_reader_alone(case: Case, written: dict[str, Path]) -> None:
    path = written[label(case)]
    assert find_reader(path, case.track) == case.reader
    sure = {name: READERS.get(name).recognise(path) for name in READERS.names()}
    assert {name for name, value in sure.items() if value >= SURE} <= {case.reader}


@pytest.fixture(scope="module")
def own(matching_world: Matching, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the results of the suite's own files."""
    folder, made, place = tmp_path_factory.mktemp("own"), matching_world, Place(noise=0.4)
    matches = made.write(folder / "matches.npz", made.matches())
    ranks, data = place.canonical(folder / "ranks.npz"), place.prepare(folder / "data")
    pairs = {"matches": (matches, made.root), "ranks": (ranks, data)}
    return {name: ab.evaluate(path, data=root) for name, (path, root) in pairs.items()}


@each(RETRIEVAL)
def test_descriptors_and_ranks(case: Case, tmp_path: Path, home: Path, own: dict[str, Any]) -> None:
    assert perfect(ab.evaluate(case.make(tmp_path / "a", Place()), protocol=PROTOCOL, data=home))
    place = Place(noise=0.4)
    found = ab.evaluate(case.make(tmp_path / "b", place), protocol=PROTOCOL, data=home)
    assert not perfect(own["ranks"])
    assert found.overall == own["ranks"].overall
    assert found.result.predictions.reader.name == case.reader
    assert found.result.predictions.reader.conventions


def _evaluated(case: Case, path: Path, made: Matching) -> Any:
    names = path.parent / "names.txt" if case.listed else None
    return ab.evaluate(path, protocol=made.protocol.name, data=made.root, names=names)


@each(EXACT)
def test_matches(
    case: Case, written: dict[str, Path], matching_world: Matching, own: dict[str, Any]
) -> None:
    found = _evaluated(case, written[label(case)], matching_world)
    assert found.overall == pytest.approx(own["matches"].overall, abs=1e-9)
    assert found.records["answered"].all()


@each(POSES)
def test_poses(case: Case, written: dict[str, Path], matching_world: Matching) -> None:
    assert _evaluated(case, written[label(case)], matching_world).overall["error_m"] < 1e-6


@each(VIEWS)
def test_views_in_any_order(
    case: Case, world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exact files are perfect, and so are turned ones, where names say which view is which."""
    path = case.write(tmp_path / "a", world)
    found = scored(world, path, names=tmp_path / "a-names.txt" if case.listed else None)
    check_perfect(found, 1e-3 if case.reader == "vggt-slam" else 1e-4, found.result.notes)
    given = found.result.predictions
    assert given.reader is not None
    assert given.reader.conventions
    lines = []

    def turned(made: World, scene: str) -> Any:
        views = true_views.true_views(made, scene)
        order = np.arange(len(views.names))[::-1]
        names = [views.names[row] for row in order]
        lines.extend(f"{scene}/{name}" for name in names)
        return type(views)(names, views.depth[order], views.intrinsics[order], views.w2c[order])

    function = getattr(case.write, "func", case.write)
    monkeypatch.setitem(function.__globals__, "true_views", turned)
    again = case.write(tmp_path / "b", world)
    listed = tmp_path / "b-names.txt"
    listed.write_text("\n".join(lines))
    assert row(scored(world, again, names=None if case.named else listed)) == row(found)


@each(REFUSED)
def test_what_cannot_be_read_is_refused(
    case: Case, written: dict[str, Path], matching_world: Matching
) -> None:
    with pytest.raises(UserError, match="pickle") as caught:
        _evaluated(case, written[label(case)], matching_world)
    assert caught.value.fix


def test_own_files_are_of_no_reader(tmp_path: Path) -> None:
    path = Place().canonical(tmp_path / "own.npz")
    assert all(READERS.get(one).recognise(path) < SURE for one in READERS.names())
    assert find_reader(path) is None


def _recognised(path: Path) -> None:
    for name in READERS.names():
        assert 0.0 <= READERS.get(name).recognise(path) <= 1.0


@each(ALL)
def test_damage_is_looked_at_without_a_word(
    case: Case, written: dict[str, Path], tmp_path: Path
) -> None:
    random = np.random.default_rng(len(label(case)))
    source = written[label(case)]
    for number in range(SPOILT):
        copy = tmp_path / str(number) / source.name
        copy.parent.mkdir()
        (shutil.copytree if source.is_dir() else shutil.copyfile)(source, copy)
        files = sorted(one for one in (copy, *copy.rglob("*")) if one.is_file())
        file = files[int(random.integers(len(files)))]
        content = file.read_bytes()
        cut = content[: int(random.integers(len(content) + 1))]
        file.write_bytes(cut if number % 2 else spoil_bytes(random, content))
        _recognised(copy)
