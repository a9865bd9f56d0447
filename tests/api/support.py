"""Calls that tests of the Python face share."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import airzoo_bench as ab
from tests.support import run_main


def refused(call: Callable[..., Any], *arguments: Any, where: str, **options: Any) -> str:
    """Call, and return the message of the refusal, which names the argument and what it expects."""
    with pytest.raises(ab.ArgumentError) as caught:
        call(*arguments, **options)
    assert isinstance(caught.value, ValueError)
    assert where in str(caught.value.where)
    return str(caught.value)


def scored(
    track: str, path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> dict[str, str]:
    """Return the averages that `eval` prints, by column, of a file that `check` finds sound."""
    assert ab.check(path, data=data).ok
    capsys.readouterr()
    assert run_main("eval", track, path, "--data", data, "--format", "csv") == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    return next(row for row in rows if row["Scene"] == "Average")
