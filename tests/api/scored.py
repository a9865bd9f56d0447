"""Scoring a prediction as its author would: `check`, then `eval`."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from airzoo_bench.evaluation.evaluate import check
from tests.support import run_main


def scored(
    track: str, path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> dict[str, str]:
    """Return the averages that `eval` prints, by column, of a file that `check` finds sound."""
    assert not check(path, data=data).errors
    capsys.readouterr()
    assert run_main("eval", track, path, "--data", data, "--format", "csv") == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    return next(row for row in rows if row["Scene"] == "Average")
