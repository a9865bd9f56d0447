from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction import distances
from airzoo_bench.reconstruction.distances import (
    NeighbourSearch,
    block_distances,
    cloud_distances,
    mutual_distances,
)
from tests.geometry.support import quick, seeds
from tests.reconstruction.cloud_support import Pieces, clouds, surface


def in_blocks(first: Floats, second: Floats, block_points: int) -> tuple[Floats, Floats]:
    found = block_distances(Pieces(first), Pieces(second), block_points=block_points, jobs=1)
    return found.to_truth, found.to_prediction


def assert_same_bits(first: Floats, second: Floats, block_points: int) -> None:
    expected = mutual_distances(first, second, jobs=1)
    found = in_blocks(first, second, block_points)
    assert np.array_equal(found[0], expected[0])
    assert np.array_equal(found[1], expected[1])


@given(clouds(), clouds(), st.integers(1, 60))
@quick
def test_no_bit_depends_on_the_size_of_blocks(
    first: Floats, second: Floats, block_points: int
) -> None:
    assert_same_bits(first, second, block_points)


@given(seeds, st.sampled_from((37, 150, 400, 5000)))
@quick
def test_surfaces_with_far_points(seed: int, block_points: int) -> None:
    assert_same_bits(surface(900, seed, far=0.05), surface(700, seed + 1), block_points)


@pytest.mark.parametrize("shift", [(0, 0, 30), (500, 0, 0), (1e7, 1e7, 0), (0.01, 0, 0)])
def test_clouds_that_lie_apart(shift: tuple[float, float, float]) -> None:
    # Here a halo of any fixed width is too small, and most points reach into many blocks.
    assert_same_bits(surface(3000, 0) + np.array(shift), surface(3000, 1), 200)


def test_clouds_in_memory_are_measured_in_a_stage_with_a_name() -> None:
    stages = []

    def progress(items: Iterable[Any], label: str, total: int) -> Iterator[Any]:
        stages.append((label, total))
        yield from items

    first, second = Pieces(surface(50, 0)), Pieces(surface(50, 1))
    cloud_distances(first, second, block_points=200, jobs=1, progress=progress)
    assert stages == [("distances", 1)]


def test_copies_fill_a_cell_however_it_is_cut() -> None:
    same = np.tile((1.0, 2.0, 3.0), (3000, 1))
    assert_same_bits(same, np.vstack((same, surface(100, 0))), 100)


def test_sizes_that_differ_much() -> None:
    assert_same_bits(surface(5000, 0), surface(3, 1), 300)


@pytest.mark.parametrize("shift", [(0, 0, 8), (40, 0, 0), (500, 0, 0), (0.01, 0, 0)])
def test_runs_and_samples_of_few_points(
    shift: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = surface(2000, 0, far=0.1) + np.array(shift), surface(2000, 1)
    monkeypatch.setattr(distances, "_RUN", 16)
    monkeypatch.setattr(distances, "_SAMPLE", 30)
    monkeypatch.setattr(distances, "_PIECE", 70)
    assert_same_bits(first, second, 100)


def test_far_points_reach_few_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[int] = []
    ask = NeighbourSearch.squared

    def counted(self: NeighbourSearch, points: Floats, *, jobs: int) -> Floats:
        searched.append(len(points))
        return ask(self, points, jobs=jobs)

    monkeypatch.setattr(NeighbourSearch, "squared", counted)
    in_blocks(surface(20_000, 0, far=0.05), surface(20_000, 1, far=0.05), 500)
    # Once each in its own block, and again for each block that those near borders reach.
    assert sum(searched) < 5 * 20_000 * 2


def test_nothing_is_left_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = surface(1000, 0)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    written: list[str] = []

    class Watched(Pieces):
        def pieces(self, points: int) -> Iterator[Cloud]:
            yield from super().pieces(points)
            written.extend(path.name for path in tmp_path.rglob("*") if path.is_file())

    block_distances(Watched(points), Watched(points), block_points=100, jobs=1)
    assert any(name.startswith("prediction") for name in written)
    assert list(tmp_path.iterdir()) == []

    class Broken(Pieces):
        def pieces(self, points: int) -> Iterator[Cloud]:
            yield from super().pieces(points)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        block_distances(Pieces(points), Broken(points), block_points=100, jobs=1)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_told_as_such(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "not there"))
    with pytest.raises(UserError, match="48 bytes"):
        in_blocks(surface(50, 0), surface(50, 1), 10)


def test_faults_of_a_source_are_not_those_of_the_disk() -> None:
    class Gone(Pieces):
        def pieces(self, points: int) -> Iterator[Cloud]:
            yield from super().pieces(points)
            raise FileNotFoundError("cloud.las")

    with pytest.raises(FileNotFoundError, match=r"cloud\.las"):
        block_distances(Pieces(surface(9, 0)), Gone(surface(9, 1)), block_points=5, jobs=1)


def scored(prediction: Floats, truth: Floats, block_points: int) -> tuple[Floats, Floats]:
    found = cloud_distances(Pieces(prediction), Pieces(truth), block_points=block_points, jobs=1)
    return found.to_truth, found.to_prediction


@pytest.mark.parametrize("block_points", [100, 2000])
def test_sources_in_memory_or_in_blocks_with_points_that_are_not_finite(block_points: int) -> None:
    prediction, truth = surface(1500, 0), surface(900, 1)
    for points, row, value in ((prediction, 7, np.nan), (truth, 800, np.inf)):
        points[row, 1] = value
    kept = np.delete(prediction, 7, axis=0), np.delete(truth, 800, axis=0)
    found = scored(prediction, truth, block_points)
    expected = mutual_distances(*kept, jobs=1)
    assert np.array_equal(found[0], expected[0])
    assert np.array_equal(found[1], expected[1])


@pytest.mark.parametrize("block_points", [2, 2000])
@pytest.mark.parametrize("nothing", [np.zeros((0, 3)), np.full((9, 3), np.nan)])
def test_nothing_predicted_is_infinitely_far_and_no_truth_an_error(
    nothing: Floats, block_points: int
) -> None:
    there, back = scored(nothing, surface(5, 0), block_points)
    assert (there.tolist(), back.tolist()) == ([], [np.inf] * 5)
    with pytest.raises(BenchmarkError, match="no finite point"):
        scored(surface(5, 0), nothing, block_points)
