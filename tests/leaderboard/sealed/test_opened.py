"""What a method is given of a sealed benchmark, and the truth that its host opens."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import UserError
from airzoo_bench.leaderboard.sealed.unsealing import opened_truth
from tests.api.place import NAME
from tests.leaderboard.sealed.conftest import SealedField
from tests.support import run_main


def test_a_method_is_given_what_it_is_given_of_the_whole(sealed: SealedField) -> None:
    whole, public = load_benchmark(sealed.folder), load_benchmark(sealed.public)
    for one, other in zip(whole.scenes, public.scenes, strict=True):
        assert [tile.id for tile in one.tiles()] == [tile.id for tile in other.tiles()]
        assert [photo.id for photo in one.photos()] == [photo.id for photo in other.photos()]
        assert [crop.window for crop in one.crops()] == [crop.window for crop in other.crops()]
        assert {p.id for p in one.queries()} <= {p.id for p in other.queries()}


TRACKS = ("retrieval", "matching", "reconstruction")


@pytest.mark.parametrize("track", TRACKS)
def test_templates_are_checked_and_not_scored(
    track: str, sealed: SealedField, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / ("preds" if track == "reconstruction" else "preds.npz")
    data = ("--data", sealed.public)
    assert run_main("template", f"{NAME}-{track}", *data, "--out", out) == 0
    assert "0.00%" not in capsys.readouterr().err
    assert run_main("check", out, *data) == 0
    assert "were not compared" not in "".join(capsys.readouterr())
    assert run_main("eval", track, out, *data) == 2
    assert "is sealed: only its host can score predictions" in capsys.readouterr().err


def test_predictions_of_another_benchmark_are_found_in_public(
    sealed: SealedField, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, ranked = tmp_path / "preds.npz", [[f"{NAME}/b", *[""] * 99]]
    np.savez(path, protocol=f"{NAME}-retrieval", query_ids=["x/a"], ranked_ids=ranked)
    assert run_main("check", path, "--data", sealed.public) in (1, 2)
    assert "none of its query ids belongs" in "".join(capsys.readouterr())


def test_opened_truth_is_private_and_goes(sealed: SealedField) -> None:
    seen = []
    for error in (None, UserError("x"), KeyboardInterrupt(), SystemExit(143)):
        try:
            with opened_truth(sealed.public, sealed.archive, sealed.key) as truth:
                folder = truth.folder
                seen.append(folder)
                assert folder.stat().st_mode & 0o077 == 0
                Benchmark.open(folder)
                if error is not None:
                    raise error
        except type(error or UserError):
            assert error is not None
        assert not folder.exists()
    assert len(set(seen)) == 4


def test_truth_of_a_killed_run_is_cleared_by_the_next(sealed: SealedField) -> None:
    read, write = os.pipe()
    child = os.fork()
    if not child:
        with opened_truth(sealed.public, sealed.archive, sealed.key) as truth:
            os.write(write, str(truth.folder).encode())
            os.kill(os.getpid(), 9)
    os.waitpid(child, 0)
    left = Path(os.read(read, 4096).decode())
    os.close(read)
    os.close(write)
    assert left.exists()
    with opened_truth(sealed.public, sealed.archive, sealed.key):
        assert not left.exists()
