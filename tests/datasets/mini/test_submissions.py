"""The submissions of this repository on AirZoo-Mini, scored again."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.datasets.mini.prepared import Prepared
from tests.support import run_main

HOME = Path(__file__).parents[3]


@pytest.mark.slow
def test_submissions_on_airzoo_mini(mini: Prepared, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(mini.root))
    monkeypatch.chdir(HOME)
    folders = [path.parent for path in HOME.glob("submissions/airzoo-mini/*/*/submission.toml")]
    assert folders
    for folder in folders:
        assert run_main("submission", "check", folder.relative_to(HOME), "--score") == 0
