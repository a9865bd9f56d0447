"""What is suspect in given data: each case is named when it is prepared, and later."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from airzoo_bench.datasets.geometry_checks.dataset import folder_facts, open_benchmark
from airzoo_bench.datasets.plausibility import Kind, scene_warnings
from tests.datasets import documented
from tests.datasets.suspect import SUSPECT
from tests.support import Place, run_main


def test_every_kind_has_a_case() -> None:
    assert {kind for _, _, kinds in SUSPECT.values() for kind in kinds} == set(Kind)


@pytest.mark.parametrize("name", ["warnings", "refusals"])
def test_the_docs_list_what_the_code_says(name: str) -> None:
    # Where this fails: python -m tests.datasets.documented
    assert documented.parts(documented.PAGE.read_text(), name)[1] == documented.lists()[name]


@pytest.mark.parametrize("name", documented.benchmarks())
def test_the_page_of_benchmarks_says_what_datasets_say(name: str) -> None:
    # Where this fails: python -m tests.datasets.documented
    page = documented.BENCHMARKS.read_text(encoding="utf-8")
    assert documented.parts(page, name)[1] == documented.benchmarks()[name]


@pytest.mark.parametrize("case", list(SUSPECT))
def test_what_is_suspect_is_named_then_and_later(
    case: str, place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    change, fragments, kinds = SUSPECT[case]
    changes = change(place)
    assert run_main(*place.arguments(**(changes or {}))) == 0
    said = capsys.readouterr()
    warned = [line[9:] for line in said.err.splitlines() if line.startswith("warning: ")]
    for fragment in fragments:
        assert any(fragment in line for line in warned), (fragment, warned)
    assert run_main("check-geometry", "park", "--format", "json") == 0
    found = json.loads(capsys.readouterr().out)["scenes"][0]
    assert found["warnings"] == warned
    facts = folder_facts(open_benchmark(Path("park")), "park")
    assert facts is not None
    assert kinds <= {kind for kind, _ in scene_warnings(facts)}
    assert run_main("check-geometry", "park") == 0
    assert "warns" in capsys.readouterr().out


def test_a_folder_of_photos_does_not_hide_the_benchmark_of_its_name(
    place: Place,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run_main(*place.arguments()) == 0
    (tmp_path / "beside" / "park").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "beside")
    assert open_benchmark(Path("park")).folder == tmp_path / "data" / "park"
    Path("other").mkdir()
    capsys.readouterr()
    assert run_main("check-geometry", "other") == 2
    assert "other: no benchmark folder here" in capsys.readouterr().err
