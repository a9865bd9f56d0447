"""Tables of benchmark folders that people made by hand: what is wrong is named to the cell."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import sha256_of
from tests.matching import world as matching
from tests.support import run_main


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ("a,1,x.jpg\nb,one,y.jpg\n", r"column 'x', row 2: 'one'\n  expected: a number, at most"),
        ("a,1_0,x.jpg\n", r"column 'x', row 1: '1_0'\n"),
        ("a,inf,x.jpg\n", r"column 'x', row 1: 'inf'\n"),
        ("a,1e300,x.jpg\n", r"column 'x', row 1: '1e300'\n"),
        ("a,1,\n", r"column 'image', row 1: nothing\n  expected: text"),
        ("a,1,a.jpg\na,1,b.jpg\n", r"column 'id', row 2: 'a'\n  expected: each id once"),
        ("a\u202eb,1,a.jpg\n", r"column 'id', row 1: 'a\\u202eb'\n"),
        ("a,,a.jpg\n", r"column 'x', row 1: nothing\n  expected: a number"),
    ],
)
def test_the_cell_is_named(cells: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "queries.csv"
    path.write_text("id,x,image\n" + cells, encoding="utf-8")
    with pytest.raises(BenchmarkError, match=rf"queries.csv: {said}"):
        read_table(path, ("id", "x", "image"), complete=("x",))


def test_whole_numbers_are_whole(tmp_path: Path) -> None:
    path = tmp_path / "crops.csv"
    path.write_text("id,crop_x\na,3\nb,3.0\n")
    assert read_table(path, ("id",))["crop_x"].tolist() == [3, 3]
    path.write_text("id,crop_x\na,3.5\nb,\nc,7\n")
    with pytest.raises(BenchmarkError, match=r"column 'crop_x', row 1: '3.5'; row 2: nothing\n"):
        read_table(path, ("id",))


def test_numbers_are_rounded_correctly(tmp_path: Path) -> None:
    numbers = np.random.default_rng(0).random(500) * 1e6
    path = tmp_path / "queries.csv"
    pd.DataFrame({"id": [f"q{n}" for n in range(500)], "x": numbers}).to_csv(path, index=False)
    np.testing.assert_array_equal(read_table(path, ("id",))["x"], numbers)


def test_names_of_digits_stay_what_they_are(tmp_path: Path) -> None:
    """The sequences 007 and 7 are two, as are the commits 1e5 and 100000."""
    path = tmp_path / "queries.csv"
    path.write_text(
        "id,sequence,commit,wind,share,gusts,fog,serial\n"
        "a,007,1e5,.5,1e-5,,True,0\nb,7,100000,2,0.25,3,False,10\n"
    )
    table = read_table(path, ("id",))
    assert table["sequence"].tolist() == ["007", "7"]
    assert table["commit"].tolist() == ["1e5", "100000"]
    assert table["wind"].tolist() == [0.5, 2.0]
    assert table["share"].tolist() == [1e-5, 0.25]
    assert np.isnan(table["gusts"][0])
    assert table["fog"].tolist() == [True, False]
    assert table["serial"].tolist() == [0, 10]


def test_degrees_are_degrees(tmp_path: Path) -> None:
    path = tmp_path / "tiles.parquet"
    pd.DataFrame({"id": ["a", "b"], "lat_min": [0, 256], "x": [0, 256]}).to_parquet(path)
    with pytest.raises(BenchmarkError, match=r"column 'lat_min', row 2: 256\n.*at most 90 in size"):
        read_table(path, ("id",))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a benchmark, ``data``, and predictions for it, ``p.npz``."""
    home = tmp_path_factory.mktemp("made")
    world = matching.make_world(home)
    world.write(home / "p.npz", world.poses())
    return home


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        (
            "queries.csv",
            lambda t: t.assign(fx=["wide", *t["fx"][1:]]),
            "column 'fx', row 1: 'wide'",
        ),
        (
            "queries.csv",
            lambda t: t.assign(x=t["x"].where(t["id"] != "hills/q3")),
            "queries.csv: column 'x', row 4 (hills/q3): nothing\n  expected: a number",
        ),
        (
            "queries.csv",
            lambda t: t.assign(prior_qw=np.nan),
            "column 'prior_qw', row 1 (hills/q0): nothing; row 2 (hills/q1): nothing",
        ),
        ("matching/crops.csv", lambda t: t.assign(crop_x="left"), "column 'crop_x', row 1: 'left'"),
        ("matching/crops.csv", lambda t: t.assign(crop_x=np.nan), "row 1: nothing"),
    ],
)
def test_a_folder_made_by_hand(
    file: str,
    change: Callable[[pd.DataFrame], pd.DataFrame],
    said: str,
    made: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / matching.SCENE
    shutil.copytree(made / "data" / matching.SCENE, folder)
    path = folder / "scenes" / matching.SCENE / file
    before = sha256_of(path)
    change(pd.read_csv(path)).to_csv(path, index=False)
    toml = folder / "benchmark.toml"
    toml.write_text(toml.read_text().replace(before, sha256_of(path)))
    assert run_main("eval", "matching", made / "p.npz", "--data", tmp_path) == 2
    message = capsys.readouterr().err
    assert said in message
    assert "Traceback" not in message
