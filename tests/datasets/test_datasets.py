"""What every built-in dataset must keep to."""

from __future__ import annotations

from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from airzoo_bench.cli.prepare import app as prepare_app
from airzoo_bench.core.registry import DATASETS, TRACKS
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.dataset import Dataset
from tests.support import run_main

SHARED = {"out", "tiles", "crops", "copy", "force"}
SPREAD = {"jobs", "engine"}


@pytest.mark.parametrize("name", DATASETS.names())
def test_it_says_what_the_command_line_asks(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "160")  # a narrow terminal cuts long names
    dataset: Dataset[Any] = DATASETS.get(name)
    assert isinstance(dataset, Dataset)
    assert is_dataclass(dataset.options)
    assert dataset.about.summary.split("\n\n")[0].endswith(".")
    assert dataset.about.example.split()[0] == name
    assert set(dataset.about.without_truth) <= set(TRACKS.names())
    assert run_main("prepare", name, "--help") == 0
    said = capsys.readouterr().out
    for field in fields(dataset.options):
        option = dataset.about.options[field.name.replace("_", "-")]
        assert option.name not in SHARED | SPREAD
        assert f"--{option.name}" in said
        assert field.default is not MISSING or f"--{option.name} " in dataset.about.example + " "
    assert all(f"--{one}" in said for one in SHARED)
    assert all(f"--{one}" in said for one in SPREAD)


@pytest.mark.parametrize("name", DATASETS.names())
def test_its_example_is_a_command(name: str, tmp_path: Path) -> None:
    dataset: Dataset[Any] = DATASETS.get(name)
    command = get_command(prepare_app)
    group = command.make_context("prepare", [], resilient_parsing=True)
    words = dataset.about.example.split()
    found = command.get_command(group, words[0])  # type: ignore[attr-defined]
    found.make_context(words[0], words[1:])


@pytest.mark.parametrize("name", DATASETS.names())
def test_what_is_published_is_told(name: str) -> None:
    about = DATASETS.get(name).about
    assert about == about_of(name)
    assert about.title
    assert bool(about.licence) == about.is_published
    assert about.page.startswith("https://") or not about.is_published
    assert not about.scene_files or about.repository
    for sentence in (*about.assumptions, *about.unverified):
        assert sentence[0].isupper() or sentence[0].isdigit()
        assert sentence.endswith(".")
