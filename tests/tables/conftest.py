"""Two results of the paper's real benchmark, and a table as CSV."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

from airzoo_bench.results.result import write_result
from tests.support import run_main
from tests.tables.two_results import CITY, RURAL, Show, made


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Write two results; the second is the better in City, the first in Rural and on average."""
    methods = {
        "Mine": {"City": CITY, "Rural": {"recall@1": 0.5}},
        "MegaLoc": {"City": {"recall@1": 0.6}, "Rural": RURAL},
    }
    for name, scenes in methods.items():
        write_result(tmp_path / f"{name}.json", made(name, scenes))
    return [tmp_path / f"{name}.json" for name in methods]


@pytest.fixture
def show(capsys: pytest.CaptureFixture[str]) -> Show:
    """Return a function that prints a table as CSV and reads it."""

    def run(*arguments: object) -> list[dict[str, str]]:
        code = run_main("table", *arguments, "--format", "csv")
        out, said = capsys.readouterr()
        assert code == 0, said
        return list(csv.DictReader(io.StringIO(out)))

    return run
