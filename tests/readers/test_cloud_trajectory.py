"""A cloud with a trajectory of TUM or KITTI next to it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from airzoo_bench.core.errors import PredictionError
from tests.readers.recon_support import check_perfect, scored, world
from tests.readers.samples import cloud_trajectory
from tests.reconstruction.world import World

__all__ = ["world"]

WRITERS = (cloud_trajectory.write, cloud_trajectory.write_kitti)


@pytest.mark.parametrize("write", WRITERS)
def test_an_exact_input_is_perfect(
    write: Callable[[Path, World], Path], world: World, tmp_path: Path
) -> None:
    found = scored(world, write(tmp_path / "out", world))
    check_perfect(found)
    assert found.given.reader is not None
    assert "camera-to-world" in found.given.reader.conventions[0]


def test_both_layouts_score_alike(world: World, tmp_path: Path) -> None:
    tum, kitti = (scored(world, write(tmp_path / write.__name__, world)) for write in WRITERS)
    assert tum.result.overall["f1_0.2m"] == kitti.result.overall["f1_0.2m"]
    assert tum.result.overall["ate_m"] == pytest.approx(kitti.result.overall["ate_m"], abs=1e-9)


def test_rows_in_another_order_are_refused(world: World, tmp_path: Path) -> None:
    path = cloud_trajectory.write(tmp_path / "out", world)
    change(path, lambda rows: rows[::-1])
    with pytest.raises(PredictionError, match="do not fit the photos in the order"):
        scored(world, path)


def change(path: Path, edit: Callable[[list[str]], list[str]]) -> None:
    text = path / "yard" / "trajectory.txt"
    head, *rows = text.read_text().splitlines()
    text.write_text("\n".join([head, *edit(rows)]) + "\n")
