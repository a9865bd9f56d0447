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


def test_fingerprint_sees_all_that_scores_depend_on(world: World) -> None:
    truth, known = world.truth, world.truth.maps[0]
    others = []
    for column in ("id", "width", "fx", "cy", "k1", "p2", *POSE_COLUMNS[1:]):
        queries = truth.queries.copy()
        queries.loc[1, column] += {"id": "x", "width": 1}.get(column, 1e-6)
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


CHANGES = {  # the file, what is replaced there, by what, and what the error says
    "rows of others": ("crops.csv", "q0", "q9", r"not those of queries\.csv"),
    "another grid": ("map.json", "500000.0", "500030.0", "another grid[\\s\\S]*500030.0"),
} | {
    f"a width of {value}": ("crops.csv", "WIDTH", value, r"crops\.csv: column '\w+', row 2")
    for value in ("wide", "12.5", "0", "-3", "299", "9999999999999999999999")
}


@pytest.mark.parametrize("case", CHANGES)
def test_a_folder_made_by_hand_is_checked(world: World, tmp_path: Path, case: str) -> None:
    name, old, new, said = CHANGES[case]
    folder = tmp_path / SCENE
    shutil.copytree(world.folder, folder)
    read_truth(Benchmark.open(folder), SCENE)
    path, file = folder / "scenes" / SCENE / "matching" / name, folder / "benchmark.toml"
    before, text = sha256_of(path), path.read_text()
    if old == "WIDTH":
        start = f"{world.ids[1]},{world.truth.crops[1, 0]},{world.truth.crops[1, 1]},"
        old, new = f"{start}{world.truth.crops[1, 2]},", f"{start}{new},"
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(BenchmarkError, match="changed since it was prepared"):
        Benchmark.open(folder)
    file.write_text(file.read_text().replace(before, sha256_of(path)))
    with pytest.raises(BenchmarkError, match=said):
        read_truth(Benchmark.open(folder), SCENE)
