"""Reading in a child under limits: what it returns, and how each limit ends it."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core import sandbox
from airzoo_bench.core.errors import BenchmarkError, PredictionError, UsageError
from airzoo_bench.core.sandbox import Limits, call_limited
from airzoo_bench.geometry.poses import Poses

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
HERE = __name__
LIMITS = Limits(64 << 20, cpu_s=20, wall_s=60)


@dataclass(frozen=True)
class Stranger:
    """A type that is not of the suite."""

    x: int = 0


def echo(value: Any) -> Any:
    return value


def made(where: Path) -> Any:
    mapped = np.load(where / "a.npy", mmap_mode="r")
    poses = Poses(rotation=np.eye(3)[None], centres=np.full((1, 3), np.nan))
    return (mapped[2:], [np.array(["a", "é"]), poses], {"b": None}, np.dtype("<f4"), where / "x")


def refuse() -> None:
    raise BenchmarkError("x is wrong", where="here", expected="y", fix="do z")


def allocate() -> Any:
    return np.ones(700 << 20, np.uint8)


def spin() -> None:
    while True:
        pass


def sleep() -> None:
    time.sleep(100)


def crash() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def hostile_object() -> Any:
    return np.array([object()], object)


def stranger() -> Any:
    return Stranger()


def elsewhere() -> Any:
    return np.memmap(__file__, np.uint8, "r")


def call(name: str, folder: Path, limits: Limits = LIMITS, **arguments: Any) -> Any:
    (folder / "out").mkdir()
    where = folder / "predictions"
    where.mkdir(exist_ok=True)
    return call_limited(
        f"{HERE}:{name}", arguments, where=where, limits=limits, folder=folder / "out"
    )


@pytest.fixture(autouse=True)
def on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))


def test_values_come_back_as_they_were(tmp_path: Path) -> None:
    given = {"a": [1, 2.5, float("inf"), "x\ud800"], "b": [True, None, Path("c")]}
    assert call("echo", tmp_path, value=given) == given


def test_arrays_of_the_predictions_are_mapped_and_others_left_in_files(tmp_path: Path) -> None:
    where = tmp_path / "predictions"
    where.mkdir()
    np.save(where / "a.npy", np.arange(8.0).reshape(4, 2))
    mapped, (names, poses), nothing, dtype, path = call("made", tmp_path, where=where)
    assert isinstance(mapped, np.memmap)
    assert Path(str(mapped.filename)) == where / "a.npy"
    assert mapped.tolist() == [[4, 5], [6, 7]]
    assert names.tolist() == ["a", "é"]
    assert np.isnan(poses.centres).all()
    assert (nothing, dtype, path) == ({"b": None}, np.dtype("<f4"), where / "x")


def test_an_array_of_another_file_is_a_copy(tmp_path: Path) -> None:
    found = call("elsewhere", tmp_path)
    assert bytes(found) == Path(__file__).read_bytes()
    assert not isinstance(found, np.memmap)


def test_faults_come_back_with_their_class(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError) as caught:
        call("refuse", tmp_path)
    error = caught.value
    assert (error.what, error.where, error.expected, error.fix) == (
        "x is wrong",
        "here",
        "y",
        "do z",
    )


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("allocate", "more than 67,108,864 bytes of memory"),
        ("spin", "more than 1 seconds of a processor"),
        ("sleep", "more than 4 seconds"),
        ("crash", "ends the process that reads it .SIGSEGV"),
        ("hostile_object", "an array of object"),
        ("stranger", "is no type of the suite"),
        ("missing", "AttributeError"),
    ],
)
def test_each_limit_is_one_clear_message(name: str, message: str, tmp_path: Path) -> None:
    begin = time.monotonic()
    limits = Limits(64 << 20, 1 if name == "spin" else 20, 4 if name == "sleep" else 60)
    with pytest.raises(PredictionError, match=message):
        call(name, tmp_path, limits)
    assert time.monotonic() - begin < 60


def test_a_map_beyond_its_file_or_outside_of_the_predictions_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1234")
    place = {"path": str(tmp_path / "a"), "start": 0, "dtype": "<f8", "shape": [2]}
    text = json.dumps({"$": "map", **place})
    with pytest.raises(ValueError, match="greater than file size"):
        sandbox._read(text, tmp_path, tmp_path)
    with pytest.raises(ValueError, match="not in the predictions"):
        sandbox._read(text, tmp_path / "b", tmp_path / "c")


def test_a_system_without_limits_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(UsageError, match="needs Linux"):
        sandbox.check_limits()
