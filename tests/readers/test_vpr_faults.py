"""VPR-methods-evaluation: runs that are not whole, and what does not belong together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import UserError
from tests.readers.retrieval_support import (
    Place,
    made_scenes,
    perfect,
    scored,
)
from tests.readers.samples import vpr

ONE = made_scenes()[:1]


def test_a_run_that_broke_off_is_left_aside(tmp_path: Path, home: Path) -> None:
    """It has a log alone; the one after it, beside it, is whole."""
    logs = vpr.write(tmp_path, Place())
    vpr.write_log(logs / "west" / "2026-11-22_18-00-00", Place().scenes[1])
    result = scored(logs, home)
    assert perfect(result)
    assert any("left aside: 1 (west/2026-11-22_18" in note for note in result.result.notes)


@pytest.mark.parametrize("lists", [False, True])
def test_two_runs_of_one_scene(tmp_path: Path, home: Path, lists: bool) -> None:
    place = Place()
    for name in ("first", "second"):
        vpr.write_log(tmp_path / "logs" / name, place.scenes[0])
        if lists:
            vpr.write_lists(tmp_path / "logs" / name, place, place.scenes[0])
        else:
            vpr.write_descriptors(tmp_path / "logs" / name, place, place.scenes[0])
    with pytest.raises(UserError, match=r"second: is a second run of what .*first answers: east/q"):
        scored(tmp_path / "logs", home)


class TestRefusals:
    """What a run left incomplete, or was not of this benchmark."""

    @pytest.mark.parametrize("name", ["queries", "database"])
    def test_half_of_the_files(self, one: Path, log: Path, name: str) -> None:
        (log / f"{name}_descriptors.npy").unlink()
        with pytest.raises(UserError, match=f"lacks {name}_descriptors.npy"):
            scored(log, one)

    def test_only_wrong_lists(self, tmp_path: Path, one: Path) -> None:
        vpr.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        vpr.write_log(tmp_path / "log", ONE[0], save_only_wrong_preds=True)
        with pytest.raises(UserError, match="--save_only_wrong_preds leaves queries out"):
            scored(tmp_path / "log", one)

    def test_a_list_that_is_lacking(self, tmp_path: Path, one: Path) -> None:
        vpr.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        (tmp_path / "log" / "preds" / "002.txt").unlink()
        with pytest.raises(UserError, match=r"lacks the lists of 1 of 6 queries \(2\)"):
            scored(tmp_path / "log", one)

    def test_tiles_of_elsewhere(self, tmp_path: Path, one: Path) -> None:
        vpr.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        file = tmp_path / "log" / "preds" / "000.txt"
        file.write_text(file.read_text().replace("t00000.png", "map.png"))
        with pytest.raises(UserError, match=r"ranks what is no tile: 1 .*map.png"):
            scored(tmp_path / "log", one)

    def test_pickles_are_not_loaded(self, one: Path, log: Path) -> None:
        np.save(log / "database_descriptors.npy", np.array([{}], dtype=object))
        with pytest.raises(UserError, match="pickled Python objects, never loaded"):
            scored(log, one)
