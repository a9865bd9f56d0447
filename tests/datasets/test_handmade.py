"""Folders made by hand get their checksums; the page names every column that there is."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tomli_w

from airzoo_bench.benchmark.folder import Benchmark
from tests.datasets.tagged import NAMES, tag
from tests.support import make_place, run_main

PAGE = Path(__file__).parents[2] / "docs" / "benchmark-folder.md"


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A complete folder with all tracks but reconstruction, tiles and crops as files."""
    home = tmp_path_factory.mktemp("handmade")
    place = make_place(home / "source")
    for name in NAMES:
        tag(place, name)
    more = ("--out", home / "park", "--tiles", "files", "--crops", "files")
    assert run_main(*place.arguments(), *more) == 0
    return home / "park"


@pytest.fixture
def folder(prepared: Path, tmp_path: Path) -> Path:
    """A copy of the folder, which a test may change."""
    return Path(shutil.copytree(prepared, tmp_path / "park"))


def change(folder: Path, *without: str) -> None:
    path = folder / "benchmark.toml"
    values = tomllib.loads(path.read_text())
    kept = {key: value for key, value in values.items() if key not in without}
    for scene in kept["scenes"]:
        scene.pop("dsm_sha256", None)
    path.write_text(tomli_w.dumps(kept))


def test_what_is_missing_is_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "benchmark.toml").read_text()
    change(folder, "schema", "name", "version", "title", "tracks", "checksums")
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
def test_a_condition_called_as_another_column_of_the_records(
    folder: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Averages would be those of both columns."""
    table = folder / "scenes" / "park" / "queries.csv"
    pd.read_csv(table).assign(**{name: 0.0, "wind": 1.5}).to_csv(table, index=False)
    assert run_main("manifest", folder, "--force") == 2
    said = capsys.readouterr().err
    assert name in said
    assert "queries.csv" in said
    pd.read_csv(table).drop(columns=name).to_csv(table, index=False)
    assert run_main("manifest", folder, "--force") == 0


def test_a_scene_without_its_files_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(folder, "checksums")
    home = folder / "scenes" / "park"
    (home / "matching").rename(home / "aside")
    before = (folder / "benchmark.toml").read_bytes()
    assert run_main("manifest", folder) == 2
    assert "has no truth for matching" in capsys.readouterr().err
    assert (folder / "benchmark.toml").read_bytes() == before
    for path in (folder / "protocols").iterdir():
        path.unlink()
    assert run_main("manifest", folder) == 2
    assert "has no protocol" in capsys.readouterr().err


def beyond_the_last_tile(home: Path) -> None:
    path = home / "retrieval" / "positives.npz"
    with np.load(path) as arrays:
        found = dict(arrays)
    found["tiles"][-1] = 10_000
    np.savez(path, **found)


def without_scenes(home: Path) -> None:
    for path in home.rglob("*.csv"):
        path.write_text(path.read_text().replace("park/", ""))


def out_of_order(home: Path) -> None:
    path = home / "retrieval" / "tiles.parquet"
    pd.read_parquet(path).iloc[::-1].to_parquet(path, index=False)


UNREADABLE = {
    "tiles out of order": (out_of_order, "tiles.parquet"),
    "no footprints": (
        lambda home: (home / "retrieval" / "footprints.csv").unlink(),
        "footprints.csv: the benchmark folder has no truth here",
    ),
    "positives beyond the last tile": (beyond_the_last_tile, "the positives are damaged"),
    "ids without the scene": (without_scenes, "ids of queries lack their scene"),
}


@pytest.mark.parametrize("what", UNREADABLE)
def test_what_eval_refuses_gets_no_checksums(
    folder: Path, what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, message = UNREADABLE[what]
    spoil(folder / "scenes" / "park")
    change(folder, "checksums")
    before = (folder / "benchmark.toml").read_bytes()
    assert run_main("manifest", folder) == 2
    said = capsys.readouterr().err
    assert message in said
    assert f"then run `airzoo-bench manifest {folder} --force`" in said or "without" in what
    assert (folder / "benchmark.toml").read_bytes() == before


def test_the_page_names_every_column(prepared: Path) -> None:
    named = set(re.findall(r"`([A-Za-z0-9_]+)`", PAGE.read_text()))
    seen = 0
    for path in sorted((prepared / "scenes").rglob("*")):
        if path.suffix == ".csv":
            columns = path.read_text().split("\n", 1)[0].split(",")
        elif path.suffix == ".parquet":
            columns = list(pd.read_parquet(path).columns)
        elif path.suffix == ".npz":
            with np.load(path) as arrays:
                columns = arrays.files
        else:
            continue
        seen += len(columns)
        assert set(columns) <= named, path
    assert seen > 100
