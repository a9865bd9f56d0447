"""One survey through the layouts of several programs: where they hold the same facts, one truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.datasets.surveys import layouts
from tests.datasets.surveys.layouts import Made, make_survey
from tests.support import run_main

EVERY: dict[str, Callable[[Made], list[object]]] = {
    "gimbal angles and degrees": layouts.gimbal_table,
    "Pix4D's omega, phi, kappa": layouts.pix4d_table,
    "Metashape's reference": layouts.metashape_table,
    "OpenDroneMap": layouts.odm_layout,
    "OpenDroneMap's shots.geojson": layouts.odm_shots_layout,
    "a newer OpenDroneMap": layouts.odm_newer_layout,
}
TRUTH = ("retrieval/tiles.parquet", "retrieval/positives.npz")


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def prepared(arguments: list[object], out: Path) -> Path:
    named = ["--name", "place", "--tile-size", 64, "--out", out]
    assert run_main("prepare", *arguments, *named) == 0
    return out / "scenes" / "place"


@pytest.mark.parametrize("layout", EVERY)
def test_same_truth_as_own_photos(layout, tmp_path, capsys):
    made = make_survey(tmp_path / "a b 测区")
    expected = prepared(layouts.photos_layout(made), tmp_path / "expected")

    found = prepared(EVERY[layout](made), tmp_path / "found")

    ours, theirs = (pd.read_csv(home / "queries.csv") for home in (found, expected))
    assert ours["image"].tolist() == theirs["image"].tolist()
    numbers = theirs.select_dtypes("number").columns
    # Tables and local frames round: 0.1 mm, 1e-8 in the quaternion, 1e-9 px.
    np.testing.assert_allclose(ours[numbers], theirs[numbers], rtol=0, atol=1.1e-4)
    turned = ["qw", "qx", "qy", "qz", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"]
    np.testing.assert_allclose(ours[turned], theirs[turned], rtol=0, atol=2e-8)
    for name in sorted(path.name for path in (expected / "retrieval").iterdir()):
        assert (found / "retrieval" / name).is_file()
    positives = [home / "retrieval" / "positives.csv" for home in (found, expected)]
    if positives[0].is_file():
        assert positives[0].read_bytes() == positives[1].read_bytes()
