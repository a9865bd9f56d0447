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


@pytest.mark.parametrize("folder", ["x" * 5000, "/dev/null", "", "\\x00", "a'b"])
def test_folders_that_are_none(one: Path, log: Path, folder: str) -> None:
    vpr.write_log(log, ONE[0], database_folder=folder)
    assert perfect(scored(log, one))


def test_a_run_that_saved_nothing(tmp_path: Path, one: Path) -> None:
    vpr.write_log(tmp_path / "log", ONE[0])
    with pytest.raises(UserError, match="neither descriptors nor lists"):
        scored(tmp_path / "log", one)


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

    def test_counts_of_another_run(self, one: Path, log: Path) -> None:
        vpr.write_log(log, ONE[0], counts=(6, 13))
        with pytest.raises(UserError, match=r"info.log speaks of 6 and 13"):
            scored(log, one)

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

    def test_a_cut_list(self, tmp_path: Path, one: Path) -> None:
        vpr.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        (tmp_path / "log" / "preds" / "002.txt").write_text("Query path:\na.jpg\n")
        with pytest.raises(UserError, match="damaged one"):
            scored(tmp_path / "log", one)

    def test_tiles_of_elsewhere(self, tmp_path: Path, one: Path) -> None:
        vpr.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        file = tmp_path / "log" / "preds" / "000.txt"
        file.write_text(file.read_text().replace("t00000.png", "map.png"))
        with pytest.raises(UserError, match=r"ranks what is no tile: 1 .*map.png"):
            scored(tmp_path / "log", one)

    def test_two_methods(self, tmp_path: Path, home: Path) -> None:
        logs = vpr.write(tmp_path, Place())
        vpr.write_log(next((logs / "west").iterdir()), Place().scenes[1], method="boq")
        with pytest.raises(UserError, match=r"runs of several methods: 2 .boq, salad"):
            scored(logs, home)

    def test_lengths_that_differ(self, tmp_path: Path, home: Path) -> None:
        logs = vpr.write(tmp_path, Place())
        west = next((logs / "west").iterdir())
        np.save(west / "database_descriptors.npy", np.eye(8, dtype=np.float32))
        with pytest.raises(UserError, match="descriptors of 8 and 24 dimensions"):
            scored(logs, home)

    def test_no_benchmark(self, tmp_path: Path, log: Path, one: Path) -> None:
        (one / "made" / "scenes" / "east" / "queries.csv").unlink()
        with pytest.raises(UserError):
            scored(log, one)

    @pytest.mark.parametrize("cut", [0, 5, 60, 128, 200])
    def test_cut_files(self, one: Path, log: Path, cut: int) -> None:
        file = log / "database_descriptors.npy"
        file.write_bytes(file.read_bytes()[:cut])
        with pytest.raises(UserError, match=r"database_descriptors\.npy"):
            scored(log, one)

    def test_pickles_are_not_loaded(self, one: Path, log: Path) -> None:
        np.save(log / "database_descriptors.npy", np.array([{}], dtype=object))
        with pytest.raises(UserError, match="pickled Python objects, never loaded"):
            scored(log, one)
