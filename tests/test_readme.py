"""The README's first command, as a newcomer types it, in a copy of the checkout."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[1]


@pytest.mark.slow
def test_the_first_command_installs_the_package_and_scores_every_track(tmp_path: Path) -> None:
    readme = (PROJECT / "README.md").read_text("utf-8")
    command = re.search(r"<!-- try -->\n```sh\n(.*?)```", readme, re.DOTALL)
    assert command is not None
    copy = tmp_path / "checkout"
    shutil.copytree(PROJECT, copy, ignore=shutil.ignore_patterns(".*", "tests", "docs"))
    run = subprocess.run(
        ["bash", "-euc", command[1]], cwd=copy, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    for track in ("retrieval", "matching", "reconstruction"):
        assert f"on airzoo-demo-{track} v" in run.stdout
