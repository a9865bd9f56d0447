"""Predictions read in a child under limits score as they do without."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.sandbox import Limits
from airzoo_bench.evaluation.evaluate import check, evaluate
from airzoo_bench.evaluation.track import Run
from tests.matching.world import make_world as make_matching
from tests.readers.samples import cut3r
from tests.reconstruction.both_scenes import both
from tests.reconstruction.world import PROTOCOL, make_world
from tests.support import run_main, write_predictions

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
MEMORY = 1 << 28


def alike(path: Path, data: Path, protocol: str | None = None, **more: Any) -> None:
    found = [
        evaluate(path, data=data, protocol=protocol, run=Run(MEMORY, limits=limits, **more))
        for limits in (None, Limits(MEMORY))
    ]
    plain, limited = (one.result.model_dump(exclude={"created", "checksum"}) for one in found)
    assert limited == plain
    pd.testing.assert_frame_equal(found[1].records, found[0].records, check_exact=True)


def test_retrieval(data: Path, tmp_path: Path, perfect: dict[str, Any]) -> None:
    alike(write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect), data)


def test_matching(tmp_path: Path) -> None:
    world = make_matching(tmp_path)
    alike(world.write(tmp_path / "p.npz", world.named(**world.matches())), world.root)


def test_clouds_of_an_archive_and_maps_read_one_by_one(tmp_path: Path) -> None:
    world = make_world(tmp_path / "data")
    alike(both(world, tmp_path), world.root, keep=True)
    (tmp_path / "native").mkdir()
    cut3r.write(tmp_path / "native", world)
    alike(tmp_path / "native", world.root, PROTOCOL)


def test_what_takes_too_much_memory_is_one_message(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ids = np.tile(np.array([f"east/t{t:07d}" for t in range(1000)]), (6, 500))
    path = tmp_path / "p.npz"
    np.savez_compressed(path, query_ids=[f"east/q{q:05d}" for q in range(6)], ranked_ids=ids)
    protocol = ("--protocol", "made-retrieval", "--data", data)
    code = run_main("eval", "retrieval", path, *protocol, "--untrusted", "--max-memory", "16M")
    said = capsys.readouterr().err
    assert code == 2, said
    assert "p.npz" in said


def test_checking_under_limits_refuses_what_it_cannot_read(data: Path, tmp_path: Path) -> None:
    (tmp_path / "p.npz").write_bytes(b"PK\x03\x04" + bytes(100))
    with pytest.raises(PredictionError, match="not an npz file"):
        check(tmp_path / "p.npz", data=data, run=Run(MEMORY, limits=Limits(MEMORY)))


def test_a_system_without_limits_is_refused_with_the_reason(
    data: Path,
    tmp_path: Path,
    perfect: dict[str, Any],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    monkeypatch.setattr("airzoo_bench.core.sandbox.sys.platform", "darwin")
    assert run_main("eval", "retrieval", path, "--data", data, "--untrusted") == 2
    assert "--untrusted: reading under limits needs Linux" in capsys.readouterr().err
