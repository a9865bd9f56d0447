from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from tests.api.place import NAME
from tests.api.scored import scored

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def run_example(name: str, track: str, out: Path) -> None:
    main = runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]
    main(NAME, f"{NAME}-{track}", str(out))


@pytest.mark.parametrize(
    ("name", "track", "column", "least", "most"),
    [
        ("retrieval_colours", "retrieval", "R@3", 90, 100),  # chance: 30
        ("matching_sift", "matching", "@1m", 100, 100),  # the prior itself: 0
        ("reconstruction_flat", "reconstruction", "F1@1m", 99, 100),  # the ground is level
    ],
)
def test_examples(
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
    run_example(name, track, out)
    line = scored(track, out, root / "data", capsys)
    assert least <= float(line[column]) <= most
