"""Matching on the real scene, as a user types it: prepare, baseline, check, eval."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from tests.support import run_main


def test_the_baseline_poses_the_real_photos(
    brighton: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    sources = {"images": "images", "poses": "poses.json", "dom": "dom_10cm.tif"}
    sources["dsm"] = "dsm_10cm.tif"
    named = [text for key, name in sources.items() for text in (f"--{key}", brighton / name)]
    tiles = ("--tile-size", 256)
    assert run_main("prepare", "photos", "--name", "brighton", *named, *tiles) == 0
    matches, out = tmp_path / "sift.npz", tmp_path / "out"
    make = ("baseline", "matching", "brighton-matching", "--out", matches)
    assert run_main(*make, "--jobs", 2) == 0
    assert run_main("check", matches) == 0
    assert run_main("eval", "matching", matches, "--out", out, "--jobs", 2) == 0
    records = pd.read_csv(out / "records.csv")
    assert len(records) == 18
    assert records["answered"].all()
    near = (records["error_m"] < 1) & (records["rotation_deg"] < 1)
    assert near.sum() >= 15
    assert records["within_1m_1deg"].sum() == near.sum()
    assert records["error_m"].median() < 1
