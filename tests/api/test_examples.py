"""The examples: methods to copy on a made-up benchmark, and the one of moved assumptions."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from airzoo_bench.retrieval.truth import read_truth
from tests.api.place import NAME
from tests.api.support import scored
from tests.support import make_place, run_main, write_predictions

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
# North-west corners of tiles that hold an anchor of each photo by more than 10 m.
SURE = {"park/a": (0, 0), "park/b": (128, 0), "park/c": (0, 128), "park/sub/d": (128, 128)}
# Of photo a, whose anchors lie at y = 31.19 and 96.81: from 5 m lower at 32.75 and 95.25.
DOUBTFUL = SURE | {"park/a": (0, 32)}


@pytest.mark.parametrize(
    ("name", "track", "column", "least", "most"),
    [
        ("retrieval_colours", "retrieval", "R@3", 90, 100),  # chance: 30
        ("matching_sift", "matching", "@1m", 100, 100),  # the prior itself: 0
        ("reconstruction_flat", "reconstruction", "F1@1m", 99, 100),  # the ground is level
    ],
)
def test_methods(
    root: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    track: str,
    column: str,
    least: float,
    most: float,
) -> None:
    out = tmp_path / ("mine" if track == "reconstruction" else "mine.npz")
    runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"](NAME, f"{NAME}-{track}", str(out))
    assert least <= float(scored(track, out, root / "data", capsys)[column]) <= most


@pytest.mark.slow
def test_a_tile_that_answers_at_another_height(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    assert run_main(*make_place(tmp_path / "sources").arguments()) == 0
    tiles = read_truth(tmp_path / "data" / "park" / "scenes" / "park", "park").tiles
    ids = {(t.x, t.y): t.id for t in tiles.itertuples() if (t.width, t.height) == (64, 64)}
    for name, corners in {"sure": SURE, "doubtful": DOUBTFUL}.items():
        firsts = [ids[corner] for corner in corners.values()]
        ranked = [[first, *[t for t in ids.values() if t != first][:9]] for first in firsts]
        arrays = {"query_ids": list(corners), "ranked_ids": ranked}
        file = write_predictions(tmp_path / f"{name}.npz", "park-retrieval", **arrays)
        assert run_main("eval", "retrieval", file, "--out", tmp_path / name) == 0
    capsys.readouterr()
    main = runpy.run_path(str(EXAMPLES / "sensitivity.py"))["main"]
    main("park", tmp_path / "sure", tmp_path / "doubtful")
    said = capsys.readouterr().out
    assert "height 5 m: sure 100.00, between 100.00 and 100.00" in said
    assert "height 5 m: doubtful 75.00, between 75.00 and 100.00" in said
    assert "height 5 m: noise floor 25.00 points" in said
