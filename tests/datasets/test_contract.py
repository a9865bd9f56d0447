"""What every dataset keeps to; goldens hold what it makes of its tree, and that once is enough."""

from __future__ import annotations

import os
import random
import shutil
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from airzoo_bench.cli.prepare import app as prepare_app
from airzoo_bench.core.registry import DATASETS, TRACKS
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.settings import PrepareSettings
from airzoo_bench.engines.dask import local_cluster
from airzoo_bench.engines.engine import HERE, Engine, Processes
from tests.engines.work import Scattered
from tests.goldens.run import CASES, run
from tests.support import run_main

SHARED = {"out", "tiles", "crops", "copy", "force", "jobs", "engine"}
PREPARED = [
    (name, line)
    for name, lines in CASES.items()
    for line in lines
    if line.startswith("prepare ") and "airzoo-mini" not in line and "|" not in line
]


@pytest.mark.parametrize("name", DATASETS.names())
def test_it_says_what_the_command_line_asks(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "160")  # a narrow terminal cuts long names
    dataset: Dataset[Any] = DATASETS.get(name)
    about = dataset.about
    assert isinstance(dataset, Dataset)
    assert is_dataclass(dataset.options)
    assert about == about_of(name)
    assert about.title
    assert about.summary.split("\n\n")[0].endswith(".")
    assert about.page.startswith("https://") or not about.is_published
    assert not about.scene_files or about.repository
    for sentence in (*about.assumptions, *about.unverified):
        assert sentence[0].isupper() or sentence[0].isdigit()
        assert sentence.endswith(".")
    assert set(about.without_truth) <= set(TRACKS.names())
    assert run_main("prepare", name, "--help") == 0
    said = capsys.readouterr().out
    for field in fields(dataset.options):
        option = about.options[field.name.replace("_", "-")]
        assert option.name not in SHARED
        assert f"--{option.name}" in said
        assert field.default is not MISSING or f"--{option.name} " in about.example + " "
    assert all(f"--{one}" in said for one in SHARED)
    group = get_command(prepare_app).make_context("prepare", [], resilient_parsing=True)
    words = about.example.split()
    found = group.command.get_command(group, words[0])  # type: ignore[attr-defined]
    assert words[0] == name
    found.make_context(words[0], words[1:])


def remove(path: Path) -> None:
    path.unlink()


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def scribble(path: Path) -> None:
    path.write_bytes(b"<html>not found</html>\n")


@pytest.mark.parametrize("number", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2))])
@pytest.mark.parametrize(("name", "command"), PREPARED, ids=[line for _, line in PREPARED])
def test_a_spoiled_file_is_no_bug_of_the_suite(
    name: str, command: str, number: int, tmp_path: Path, tree: Callable[[str], Path]
) -> None:
    """It is named, or it is not read."""
    whole = Path(shutil.copytree(tree(name), tmp_path / "whole"))
    source = whole / "in" if (whole / "in").is_dir() else whole
    files = [path.relative_to(whole) for path in sorted(source.rglob("*")) if path.is_file()]
    order = random.Random(f"{command} {number}")
    file, spoil = order.choice(files), order.choice((remove, cut, scribble))
    spoil(whole / file)
    code, said = run(command, whole)
    assert code in (0, 1, 2), f"{spoil.__name__} {file}: exit {code}\n{said}"
    assert "bug of the suite" not in said
    assert "fix:" in said or "expected:" in said or code == 0, f"{file}: {said}"


def prepared(source: Path, home: Path, engine: Engine) -> dict[str, bytes]:
    """Return the files of the folder that is made of a tree, by relative paths."""
    dataset, data = DATASETS.get(source.name), home / "data"
    settings = PrepareSettings(home / "made", data, copy=True, engine=engine)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AIRZOO_BENCH_DATA", str(data))
        patch.chdir(source.parent)
        made = dataset.prepare(dataset.options(source=Path(source.name)), settings)
        assert len(made.summaries) > 1
    files = [path for path in sorted(made.folder.rglob("*")) if path.is_file()]
    found = {path.relative_to(made.folder).as_posix(): path.read_bytes() for path in files}
    shutil.rmtree(home)  # there are maps and clouds that runs share
    return found


@pytest.mark.parametrize(
    "name", ["university-1652", pytest.param("uav-visloc", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "workers", [None, *(pytest.param(n, marks=pytest.mark.slow) for n in ("processes", "cluster"))]
)
def test_scenes_are_pure_tasks(
    name: str, workers: str | None, tmp_path: Path, tree: Callable[[str], Path]
) -> None:
    """Any workers, also of another folder than this process, make the same."""
    source, home = tmp_path / name, tmp_path / "home"
    shutil.copytree(tree(name) / "in", source)
    here = prepared(source, home, HERE)
    if workers == "processes":
        assert prepared(source, home, Processes(2)) == here
    elif workers == "cluster":
        with local_cluster(2) as cluster:
            cluster.client.run(os.chdir, "/")
            cluster.client.run(os.environ.update, {"AIRZOO_BENCH_DATA": str(home / "data")})
            assert prepared(source, home, cluster) == here
    else:
        engine = Scattered()
        assert prepared(source, home, engine) == here
        assert engine.stages["scenes"] > 1
