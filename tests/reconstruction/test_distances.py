from __future__ import annotations

import gc
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.distances import clouds as clouds_module
from airzoo_bench.reconstruction.distances import spill
from airzoo_bench.reconstruction.distances.clouds import block_distances, cloud_distances
from airzoo_bench.reconstruction.distances.neighbours import mutual_distances
from airzoo_bench.reconstruction.distances.spill import cells_of, spilled
from tests.geometry.support import quick, seeds
from tests.reconstruction.cloud_support import Pieces, clouds, surface


def cut(points: Floats, size: int) -> Iterator[Floats]:
    for start in range(0, len(points), size):
        yield points[start : start + size]


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


def test_copies_fill_a_cell_however_it_is_cut() -> None:
    same = np.tile((1.0, 2.0, 3.0), (3000, 1))
    assert_same_bits(same, np.vstack((same, surface(100, 0))), 100)


def test_sizes_that_differ_much() -> None:
    assert_same_bits(surface(5000, 0), surface(3, 1), 300)


@pytest.mark.parametrize("patience", [0, 1, 50])
def test_waiting_points_are_worked_off_in_between(
    monkeypatch: pytest.MonkeyPatch, patience: int
) -> None:
    first, second = surface(2000, 0, far=0.1) + np.array((0.0, 0.0, 8.0)), surface(2000, 1)
    build = clouds_module._Search

    def impatient(*arguments: object) -> clouds_module._Search:
        return build(*arguments[:-1], patience)  # type: ignore[arg-type]

    monkeypatch.setattr(clouds_module, "_Search", impatient)
    monkeypatch.setattr(clouds_module, "_RUN", 16)
    monkeypatch.setattr(clouds_module, "_PAIRS", 500)
    monkeypatch.setattr(clouds_module, "_SAMPLE", 30)
    assert_same_bits(first, second, 100)


def test_far_points_reach_few_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[int] = []
    ask = clouds_module.NeighbourSearch.squared

    def counted(self: clouds_module.NeighbourSearch, points: Floats, *, jobs: int) -> Floats:
        searched.append(len(points))
        return ask(self, points, jobs=jobs)

    monkeypatch.setattr(clouds_module.NeighbourSearch, "squared", counted)
    in_blocks(surface(20_000, 0, far=0.05), surface(20_000, 1, far=0.05), 500)
    # Once each in its own cell; what is beyond is for those near borders, or far outside.
    assert sum(searched) < 2 * 20_000 * 2


def test_nothing_is_left_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    points = surface(1000, 0)
    cells = cells_of(points, 8)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with spilled(cut(points, 100), cells, most=200) as cloud:
        assert cloud.count == 1000
    assert list(tmp_path.iterdir()) == []

    class Broken(Pieces):
        def pieces(self, points: int) -> Iterator[Cloud]:
            yield from super().pieces(points)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        block_distances(Pieces(points), Broken(points), block_points=100, jobs=1)
    gc.collect()
    assert list(tmp_path.iterdir()) == []


@given(clouds(), st.integers(1, 70), st.integers(1, 40))
@quick
def test_a_spilled_cloud_comes_back_whole(points: Floats, count: int, piece: int) -> None:
    cells = cells_of(points[::2], count)
    assert count <= cells.count < 2 * count or count == 1
    with spilled(cut(points, piece), cells, most=piece) as cloud:
        seen = []
        for cell in range(cloud.cell_count):
            for block in cloud.blocks(cell):
                there, numbers = cloud.read(block)
                assert len(there) == block.count <= piece
                assert (cells.of(there) == cell).all()
                assert np.array_equal(there, points[numbers])
                assert np.array_equal(there.min(axis=0), block.low)
                assert np.array_equal(there.max(axis=0), block.high)
                seen += numbers.tolist()
    assert sorted(seen) == list(range(len(points)))


def test_cells_hold_about_as_many_points_each() -> None:
    points = surface(8000, 0, far=0.05)
    cells = cells_of(points, 16)
    held = np.bincount(cells.of(points), minlength=16)
    assert (cells.count, held.min(), held.max()) == (16, 500, 500)


def spill_one(pieces: Iterable[Floats]) -> None:
    with spilled(pieces, cells_of(np.zeros((1, 3)), 1), most=1):
        pass


def test_a_full_disk_is_told_as_such(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "not there"))
    with pytest.raises(UserError, match="cannot be kept on disk") as caught:
        spill_one([np.zeros((1, 3))])
    assert "32 bytes" in str(caught.value)

    class Full:
        def __enter__(self) -> Full:
            return self

        def __exit__(self, *_: object) -> None: ...

        def tell(self) -> int:
            return 0

        def write(self, _: object) -> None:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(spill.tempfile, "TemporaryFile", Full)
    with pytest.raises(UserError, match="No space left"):
        spill_one([np.zeros((1, 3))])


def test_faults_of_a_source_are_not_those_of_the_disk() -> None:
    def unreadable() -> Iterator[Floats]:
        yield np.zeros((1, 3))
        raise FileNotFoundError("cloud.las")

    with pytest.raises(FileNotFoundError, match=r"cloud\.las"):
        spill_one(unreadable())


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
