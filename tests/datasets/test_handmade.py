"""Folders made by hand get their checksums; the page names every column that there is."""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tomli_w

from airzoo_bench.benchmark.folder import Benchmark
from tests.datasets.tagged import NAMES, tag
from tests.shared import made_once
from tests.support import make_place, run_main

PAGE = Path(__file__).parents[2] / "docs" / "benchmark-folder.md"


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A complete folder with all tracks but reconstruction, tiles and crops as files."""

    def make(home: Path) -> None:
        place = make_place(home / "source")
        for name in NAMES:
            tag(place, name)
        more = ("--out", home / "park", "--tiles", "files", "--crops", "files")
        assert run_main(*place.arguments(tile_size=128), *more) == 0

    return made_once(tmp_path_factory, "handmade", make) / "park"


@pytest.fixture
def folder(prepared: Path, tmp_path: Path) -> Path:
    """A copy of the folder, which a test may change."""
    return Path(shutil.copytree(prepared, tmp_path / "park"))


def strip(folder: Path, *without: str) -> bytes:
    """Take entries from benchmark.toml; return what is left."""
    path = folder / "benchmark.toml"
    values = tomllib.loads(path.read_text())
    kept = {key: value for key, value in values.items() if key not in without}
    for scene in kept["scenes"]:
        scene.pop("dsm_sha256", None)
    path.write_text(tomli_w.dumps(kept))
    return path.read_bytes()


def test_missing_entries_are_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "benchmark.toml").read_text()
    strip(folder, "schema", "name", "version", "title", "tracks", "checksums")
    assert run_main("manifest", folder) == 0
    assert "dsm_sha256 of scene park" in capsys.readouterr().err
    after = tomllib.loads((folder / "benchmark.toml").read_text())
    assert after == tomllib.loads(before) | {"by_hand": True}
    assert Benchmark.open(folder).name == "park"


def test_a_changed_file_gets_a_new_checksum_only_if_that_is_asked(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = folder / "scenes" / "park" / "queries.csv"
    table.write_text(table.read_text().replace("64", "65"))
    assert run_main("manifest", folder) == 2
    assert "was changed since" in capsys.readouterr().err
    assert run_main("manifest", folder, "--force") == 0
    Benchmark.open(folder)


@pytest.mark.parametrize("name", ["error_m", "within_5m", "scene", "tile@9"])
def test_a_condition_named_as_another_column_of_the_records(
    folder: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Averages would be those of both columns."""
    table = folder / "scenes" / "park" / "queries.csv"
    pd.read_csv(table).assign(**{name: 0.0, "wind": 1.5}).to_csv(table, index=False)
    assert run_main("manifest", folder, "--force") == 2
    said = capsys.readouterr().err
    assert name in said
    assert "queries.csv" in said


def beyond_the_last_tile(scene: Path) -> None:
    path = scene / "retrieval" / "positives.npz"
    with np.load(path) as arrays:
        found = dict(arrays)
    found["tiles"][-1] = 10_000
    np.savez(path, **found)


def without_scenes(scene: Path) -> None:
    for path in scene.rglob("*.csv"):
        path.write_text(path.read_text().replace("park/", ""))


def out_of_order(scene: Path) -> None:
    path = scene / "retrieval" / "tiles.parquet"
    pd.read_parquet(path).iloc[::-1].to_parquet(path, index=False)


UNREADABLE: list[tuple[Callable[[Path], object], str]] = [
    (out_of_order, "tiles.parquet"),
    (lambda scene: (scene / "retrieval" / "footprints.csv").unlink(), "footprints.csv"),
    (beyond_the_last_tile, "positives"),
    (without_scenes, "ids of queries lack their scene"),
    (lambda scene: shutil.rmtree(scene / "matching"), "matching"),
    (lambda scene: shutil.rmtree(scene.parents[1] / "protocols"), "has no protocol"),
]


@pytest.mark.parametrize(("spoil", "message"), UNREADABLE)
def test_a_folder_that_eval_refuses_gets_no_checksums(
    spoil: Callable[[Path], object],
    message: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    spoil(folder / "scenes" / "park")
    before = strip(folder, "checksums")
    assert run_main("manifest", folder) == 2
    assert message in capsys.readouterr().err
    assert (folder / "benchmark.toml").read_bytes() == before


def test_the_page_names_every_column(prepared: Path) -> None:
    named = set(re.findall(r"`([A-Za-z0-9_]+)`", PAGE.read_text()))
    seen = 0
    for path in sorted((prepared / "scenes").rglob("*")):
        columns: list[str] = []
        if path.suffix == ".csv":
            columns = path.read_text().split("\n", 1)[0].split(",")
        elif path.suffix == ".parquet":
            columns = list(pd.read_parquet(path).columns)
        elif path.suffix == ".npz":
            with np.load(path) as arrays:
                columns = arrays.files
        seen += len(columns)
        assert set(columns) <= named, path
    assert seen > 100
