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
from airzoo_bench.core.errors import BenchmarkError, PredictionError
from airzoo_bench.core.sandbox import Limits, call_limited
from airzoo_bench.geometry.poses import Poses

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")


@dataclass(frozen=True)
class Stranger:
    """A type that is not of the suite."""

    x: int = 0


def echo(value: Any, where: Path) -> Any:
    poses = Poses(rotation=np.eye(3)[None], centres=np.full((1, 3), np.nan))
    return value, np.load(where / "a.npy", mmap_mode="r")[2:], poses, np.dtype("<f4")


def misbehave(how: str) -> Any:
    if how == "refuse":
        raise BenchmarkError("x is wrong", where="here", expected="y", fix="do z")
    if how == "sleep":
        time.sleep(100)
    while how == "spin":
        pass
    if how.startswith("SIG"):
        os.kill(os.getpid(), getattr(signal, how))
    if how == "allocate":
        return np.ones(700 << 20, np.uint8)
    return np.array([object()], object) if how == "object" else Stranger()


def call(name: str, folder: Path, limits: Limits, **arguments: Any) -> Any:
    (folder / "out").mkdir()
    (folder / "predictions").mkdir(exist_ok=True)
    given = {"where": folder / "predictions", "folder": folder / "out", "limits": limits}
    return call_limited(f"{__name__}:{name}", arguments, **given)


@pytest.fixture(autouse=True)
def on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))


def test_values_come_back_as_they_were(tmp_path: Path) -> None:
    given = {"a": [1, 2.5, float("inf"), "x\ud800"], "b": [True, None, Path("c")]}
    np.save(tmp_path / "a.npy", np.arange(8.0).reshape(4, 2))
    value, rows, poses, dtype = call(
        "echo", tmp_path, Limits(64 << 20), value=given, where=tmp_path
    )
    assert value == given
    assert rows.tolist() == [[4, 5], [6, 7]]
    assert np.isnan(poses.centres).all()
    assert dtype == np.dtype("<f4")


def test_faults_come_back_with_their_class(tmp_path: Path) -> None:
    with pytest.raises(BenchmarkError) as caught:
        call("misbehave", tmp_path, Limits(64 << 20), how="refuse")
    error = caught.value
    texts = (error.what, error.where, error.expected, error.fix)
    assert texts == ("x is wrong", "here", "y", "do z")


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("allocate", "67,108,864 bytes"),
        ("spin", "1 seconds of a processor"),
        ("sleep", "2 seconds"),
        ("SIGSEGV", "SIGSEGV"),
        ("SIGKILL", "SIGKILL"),  # as of a machine without memory
        ("object", "cannot be saved"),
        ("stranger", "is no type of the suite"),
    ],
)
def test_each_limit_is_one_clear_message(how: str, message: str, tmp_path: Path) -> None:
    limits = Limits(64 << 20, 1 if how == "spin" else 20, 2 if how == "sleep" else 60)
    with pytest.raises(PredictionError, match=message):
        call("misbehave", tmp_path, limits, how=how)


@pytest.mark.parametrize(
    "answer",
    [
        ["array", "../predictions/a"],
        ["dataclass", "subprocess:Popen", {"args": ["touch", "PLACE/x"]}],
        ["dataclass", "airzoo_bench.core.files:sha256_of", {"path": "PLACE/predictions/a"}],
        ["error", "SystemExit", {"code": 3}],
    ],
)
def test_what_a_hostile_child_answers_is_refused(answer, tmp_path, monkeypatch) -> None:
    def lie(where: Path, limits: Limits, folder: Path, _: object) -> None:
        (where / "a").write_bytes(b"1234")
        text = json.dumps({"$": answer}).replace("PLACE", str(tmp_path))
        (folder / "answer.json").write_text(text)

    monkeypatch.setattr(sandbox, "_run_child", lie)
    with pytest.raises(PredictionError, match="cannot be read under limits"):
        call("echo", tmp_path, Limits(64 << 20))
    assert not (tmp_path / "x").exists()
