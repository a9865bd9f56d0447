from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.engines.engine import Engine, Here
from airzoo_bench.engines.kept import Kept
from tests.engines.work import Arrays, named


def told(folder: Path, number: int) -> Arrays:
    """Square a number, and say in a file that it was done."""
    with (folder / "done").open("a") as stream:
        stream.write(f"{number} ")
    if (folder / "stop").exists() and number == 3:
        raise KeyboardInterrupt
    return {"square": np.array([number * number]), "name": np.array(f"n{number}")}


def kept(
    tmp_path: Path, *, reuse: bool = True, run: str = "a", inner: Engine | None = None
) -> Kept:
    made = Kept(inner or Here(), tmp_path / "out.unfinished", reuse=reuse)
    made.begin(run)
    return made


def squares(engine: Engine, folder: Path, count: int = 6, stage: str = "squares") -> list[int]:
    found = engine.map(told, range(count), shared=folder, stage=stage, name=named)
    return [int(one["square"][0]) for one in found]


def done(folder: Path) -> list[int]:
    """Return what was done since the last call."""
    file = folder / "done"
    text = file.read_text() if file.exists() else ""
    file.unlink(missing_ok=True)
    return [int(number) for number in text.split()]


SQUARES = [0, 1, 4, 9, 16, 25]


@pytest.fixture
def stopped(tmp_path: Path) -> Path:
    """Return a folder in which a run was stopped in the middle of task 3."""
    (tmp_path / "stop").touch()
    with pytest.raises(KeyboardInterrupt):
        squares(kept(tmp_path), tmp_path)
    (tmp_path / "stop").unlink()
    assert done(tmp_path) == [0, 1, 2, 3]
    return tmp_path


def files(folder: Path) -> list[Path]:
    return sorted((folder / "out.unfinished").glob("*.task"))


def test_a_run_goes_on_from_what_was_finished(stopped: Path) -> None:
    again = kept(stopped)
    assert again.leftovers == 3
    assert squares(again, stopped) == SQUARES
    assert done(stopped) == [3, 4, 5]
    assert squares(kept(stopped), stopped) == SQUARES
    assert done(stopped) == []


def test_results_are_the_same_arrays(stopped: Path) -> None:
    first, *_ = kept(stopped).map(told, range(6), shared=stopped, stage="squares", name=named)
    assert done(stopped) == [3, 4, 5]
    fresh = told(stopped, 0)
    assert list(first) == list(fresh)
    for name, array in fresh.items():
        assert first[name].dtype == array.dtype
        assert first[name].shape == array.shape
        assert first[name].tobytes() == array.tobytes()


def test_without_reuse_all_is_done_again(stopped: Path) -> None:
    assert squares(kept(stopped, reuse=False), stopped) == SQUARES
    assert done(stopped) == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    "change", [{"run": "b"}, {"count": 5}, {"stage": "others"}], ids=["run", "cut", "stage"]
)
def test_tasks_of_another_run_are_not_used(stopped: Path, change: dict[str, str]) -> None:
    run = change.pop("run", "a")
    squares(kept(stopped, run=run), stopped, **change)
    assert {0, 1, 2} <= set(done(stopped))


def test_two_stages_of_one_name_are_told_apart(tmp_path: Path) -> None:
    engine = kept(tmp_path)
    squares(engine, tmp_path)
    squares(engine, tmp_path)
    assert len(done(tmp_path)) == 12


def damaged(data: bytes, how: str) -> bytes:
    half = len(data) // 2
    return {
        "cut": data[:half],
        "empty": b"",
        "a bit": data[:half] + bytes([data[half] ^ 1]) + data[half + 1 :],
        "no head": data.partition(b"\n")[2],
        "garbage": b"\x00" * 200,
    }[how]


@pytest.mark.parametrize("how", ["cut", "empty", "a bit", "no head", "garbage"])
def test_a_damaged_file_is_never_used(stopped: Path, how: str) -> None:
    for file in files(stopped):
        file.write_bytes(damaged(file.read_bytes(), how))
    assert squares(kept(stopped), stopped) == SQUARES
    assert sorted(done(stopped)) == [0, 1, 2, 3, 4, 5]


def test_the_file_of_another_task_is_never_used(stopped: Path) -> None:
    one, two, three = files(stopped)
    contents = [file.read_bytes() for file in (two, three, one)]
    for file, content in zip((one, two, three), contents, strict=True):
        file.write_bytes(content)
    assert squares(kept(stopped), stopped) == SQUARES
    assert sorted(done(stopped)) == [0, 1, 2, 3, 4, 5]


def test_a_folder_that_vanishes_on_the_way_does_no_harm(stopped: Path) -> None:
    found = kept(stopped).map(told, range(6), shared=stopped, stage="squares", name=named)
    values = [int(next(found)["square"][0])]
    shutil.rmtree(stopped / "out.unfinished")
    assert [*values, *(int(one["square"][0]) for one in found)] == SQUARES


def test_nothing_is_kept_before_a_run_begins(tmp_path: Path) -> None:
    engine = Kept(Here(), tmp_path / "out.unfinished", reuse=True)
    assert squares(engine, tmp_path) == SQUARES
    assert not (tmp_path / "out.unfinished").exists()


def test_what_is_kept_goes_when_the_run_is_saved_and_nothing_else(stopped: Path) -> None:
    engine, folder = kept(stopped), stopped / "out.unfinished"
    (folder / "thesis.tex").touch()
    engine.remove()
    assert [path.name for path in folder.iterdir()] == ["thesis.tex"]
    (folder / "thesis.tex").unlink()
    engine.remove()
    assert not folder.exists()


def test_a_folder_of_another_kind_is_refused_and_stays(tmp_path: Path) -> None:
    (tmp_path / "out.unfinished").mkdir()
    (tmp_path / "out.unfinished" / "thesis.tex").write_text("")
    with pytest.raises(UsageError, match="holds something else"):
        kept(tmp_path)
    assert (tmp_path / "out.unfinished" / "thesis.tex").exists()


def no_arrays(shared: None, number: int) -> object:
    del shared
    return {"a": np.array([object()])} if number else [1, 2]


@pytest.mark.parametrize("number", [0, 1])
def test_results_that_cannot_be_kept_are_a_bug(tmp_path: Path, number: int) -> None:
    with pytest.raises(TypeError, match="mappings of str to arrays"):
        list(kept(tmp_path).map(no_arrays, [number], shared=None, stage="s", name=named))


def test_work_is_cut_where_it_is_kept(tmp_path: Path) -> None:
    assert len(Here().cut(10, 4)) == 1
    assert kept(tmp_path).cut(10, 4) == [slice(0, 4), slice(4, 8), slice(8, 10)]
