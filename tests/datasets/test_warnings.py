"""What is suspect in given data is named by its code when it is prepared."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from airzoo_bench.datasets.geometry_checks.scenes import open_benchmark
from airzoo_bench.datasets.scene_warnings import Code
from tests.datasets import documented, suspect_places
from tests.support import Place, run_main

LINES = (Path(__file__).parent / "warnings.txt").read_text().splitlines()
CASES = dict(line.split(" |") for line in LINES if line and not line.startswith("#"))


def test_every_code_has_a_case() -> None:
    assert {code for codes in CASES.values() for code in codes.split()} == set(Code)


def test_the_page_of_benchmarks_has_what_datasets_say() -> None:
    # Where this fails: python -m tests.datasets.documented
    page = documented.PAGE.read_text(encoding="utf-8")
    assert documented.MARKER + documented.overview() in page


@pytest.mark.parametrize("case", CASES)
def test_what_is_suspect_is_named(
    case: str, place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = getattr(suspect_places, case)(place) or {}
    assert run_main(*place.arguments(**({"tile_size": 128} | changes))) == 0
    said = capsys.readouterr().err
    warned = [line[9:] for line in said.splitlines() if line.startswith("warning: ")]
    codes = {code for line in warned for code in re.findall(r"\[([a-z0-9-]+)\]$", line)}
    assert codes == set(CASES[case].split()), warned


def test_a_folder_of_photos_does_not_hide_the_benchmark_of_its_name(
    place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run_main(*place.arguments()) == 0
    (tmp_path / "beside" / "park").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "beside")
    assert open_benchmark(Path("park")).folder == tmp_path / "data" / "park"
