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
    other = np.memmap(__file__, np.uint8, "r")
    return mapped[2:], other, [np.array(["a", "é"]), poses], {"b": None}, np.dtype("<f4")


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


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def hostile_object() -> Any:
    return np.array([object()], object)


def stranger() -> Any:
    return Stranger()


def call(name: str, folder: Path, limits: Limits = LIMITS, **arguments: Any) -> Any:
    (folder / "out").mkdir()
    (folder / "predictions").mkdir(exist_ok=True)
    given = {"where": folder / "predictions", "folder": folder / "out", "limits": limits}
    return call_limited(f"{__name__}:{name}", arguments, **given)


@pytest.fixture(autouse=True)
def on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))


def test_values_come_back_as_they_were(tmp_path: Path) -> None:
    given = {"a": [1, 2.5, float("inf"), "x\ud800"], "b": [True, None, Path("c")]}
    assert call("echo", tmp_path, value=given) == given


def test_arrays_come_back_by_files(tmp_path: Path) -> None:
    where = tmp_path / "predictions"
    where.mkdir()
    np.save(where / "a.npy", np.arange(8.0).reshape(4, 2))
    mapped, other, (names, poses), nothing, dtype = call("made", tmp_path, where=where)
    assert mapped.tolist() == [[4, 5], [6, 7]]
    assert bytes(other) == Path(__file__).read_bytes()
    assert names.tolist() == ["a", "é"]
    assert np.isnan(poses.centres).all()
    assert (nothing, dtype) == ({"b": None}, np.dtype("<f4"))


def test_faults_come_back_with_their_class(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError) as caught:
        call("refuse", tmp_path)
    error = caught.value
    texts = (error.what, error.where, error.expected, error.fix)
    assert texts == ("x is wrong", "here", "y", "do z")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("allocate", "67,108,864 bytes"),
        ("spin", "1 seconds of a processor"),
        ("sleep", "2 seconds"),
        ("crash", "SIGSEGV"),
        ("die", "SIGKILL"),
        ("hostile_object", "cannot be saved"),
        ("stranger", "is no type of the suite"),
        ("missing", "AttributeError"),
    ],
)
def test_each_limit_is_one_clear_message(name: str, message: str, tmp_path: Path) -> None:
    limits = Limits(64 << 20, 1 if name == "spin" else 20, 2 if name == "sleep" else 60)
    with pytest.raises(PredictionError, match=message):
        call(name, tmp_path, limits)


@pytest.mark.parametrize(
    "answer",
    [
        {"$": ["array", "../predictions/a"]},
        {"$": ["dataclass", "subprocess:Popen", {"args": ["touch", "PLACE/x"]}]},
        {"$": ["dataclass", "airzoo_bench.core.files:sha256_of", {"path": "PLACE/predictions/a"}]},
        {"$": ["error", "SystemExit", {"code": 3}]},
    ],
)
def test_what_a_hostile_child_answers_is_refused(
    answer: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lie(where: Path, limits: Limits, folder: Path, _: object) -> None:
        (where / "a").write_bytes(b"1234")
        text = json.dumps(answer).replace("PLACE", str(tmp_path))
        (folder / "answer.json").write_text(text)

    monkeypatch.setattr(sandbox, "_run_child", lie)
    with pytest.raises(PredictionError, match="cannot be read under limits"):
        call("echo", tmp_path)
    assert not (tmp_path / "x").exists()


def test_a_system_without_limits_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with pytest.raises(UsageError, match="needs Linux"):
        sandbox.check_limits()
