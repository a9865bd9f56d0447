"""Truth written and read, and what its fingerprint sees."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from rasterio import Affine

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import POSE_COLUMNS
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.matching.truth import read_truth
from tests.matching.world import SCENE, World


@pytest.fixture
def copied(world: World, tmp_path: Path) -> Path:
    """Return a copy of the benchmark folder with the surface model in it."""
    folder, dsm = tmp_path / SCENE, world.truth.maps[0].dsm
    shutil.copytree(world.folder, folder)
    shutil.copy(dsm, folder / "dsm.tif")
    file = folder / "benchmark.toml"
    file.write_text(file.read_text().replace(f'"{dsm}"', '"dsm.tif"'))
    return folder


def test_fingerprint_sees_all_that_scores_depend_on(world: World) -> None:
    truth, known = world.truth, world.truth.maps[0]
    others = []
    for column in ("id", "width", "fx", "cy", "k1", "p2", *POSE_COLUMNS[1:]):
        queries = truth.queries.copy()
        step = {"id": "x", "width": 1}.get(column, 1e-6)
        queries.loc[1, column] += step
        others.append(replace(truth, queries=queries))
    crops = truth.crops.copy()
    crops[2, 3] += 1
    others.append(replace(truth, crops=crops))
    shifted = known.dom.transform @ Affine.translation(0.5, 0.5)
    for one in (
        replace(known, dsm_sha256="0" * 64),
        replace(known, dom=replace(known.dom, transform=shifted)),
        replace(known, dom=replace(known.dom, width=known.dom.width + 1)),
    ):
        others.append(replace(truth, maps=(one,)))
    prints = {truth.fingerprint, *(other.fingerprint for other in others)}
    assert len(prints) == 1 + len(others) == 17


def test_crops_of_other_queries_are_refused(copied: Path) -> None:
    benchmark = Benchmark.open(copied)  # checksums hold here
    crops = copied / "scenes" / SCENE / "matching" / "crops.csv"
    lines = crops.read_text().splitlines(keepends=True)
    crops.write_text("".join([lines[0], *lines[:0:-1]]))
    with pytest.raises(BenchmarkError, match=r"not those of queries\.csv"):
        read_truth(benchmark, SCENE)
    with pytest.raises(BenchmarkError, match="changed since it was prepared"):
        Benchmark.open(copied)


def rewritten(folder: Path, name: str, old: str, new: str) -> Benchmark:
    """Change a file of the truth and its checksum, as one who makes a folder by hand does."""
    path, file = folder / "scenes" / SCENE / "matching" / name, folder / "benchmark.toml"
    before, text = sha256_of(path), path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    file.write_text(file.read_text().replace(before, sha256_of(path)))
    return Benchmark.open(folder)


@pytest.mark.parametrize("value", ["wide", "12.5", "0", "-3", "299", "9999999999999999999999"])
def test_a_bad_crop_is_named_by_its_row(world: World, copied: Path, value: str) -> None:
    x, y, width, _ = world.truth.crops[1].tolist()
    row = f"{world.ids[1]},{x},{y},"
    benchmark = rewritten(copied, "crops.csv", f"{row}{width},", f"{row}{value},")
    with pytest.raises(BenchmarkError, match=r"crops\.csv: column '\w+', row 2"):
        read_truth(benchmark, SCENE)


def test_a_map_of_another_grid_is_refused(world: World, copied: Path) -> None:
    read_truth(Benchmark.open(copied), SCENE)
    moved = rewritten(copied, "map.json", f"{world.truth.maps[0].dom.transform.c}", "500030.0")
    with pytest.raises(BenchmarkError, match="another grid") as caught:
        read_truth(moved, SCENE)
    assert "500030.0" in str(caught.value)
