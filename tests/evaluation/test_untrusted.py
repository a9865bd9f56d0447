"""Predictions read in a child under limits score as they do without."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from airzoo_bench.core.sandbox import Limits
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.track import Run
from tests.matching.world import make_world as make_matching
from tests.readers.method_files import WRITERS
from tests.reconstruction.world import PROTOCOL, make_world, predict_clouds, true_points
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


def test_clouds_of_a_folder(tmp_path: Path) -> None:
    world = make_world(tmp_path / "data")
    clouds = predict_clouds(world, tmp_path / "p", {"lot": true_points("lot")}, cameras=False)
    alike(clouds, world.root, keep=True)


@pytest.mark.slow
def test_maps_read_one_by_one(tmp_path: Path) -> None:
    world = make_world(tmp_path / "data")
    alike(WRITERS["cut3r"](tmp_path / "native", world), world.root, PROTOCOL)


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
