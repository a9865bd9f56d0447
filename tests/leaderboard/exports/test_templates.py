"""Texts of bundles: names are escaped, nothing is left open, and a missing jinja2 is said."""

from __future__ import annotations

import importlib
from types import ModuleType

import jinja2
import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.leaderboard.exports import templates
from tests.leaderboard.exports.platform import IMAGE, Made, make
from tests.support import run_main


def test_a_missing_name_is_an_error() -> None:
    with pytest.raises(jinja2.UndefinedError):
        templates.rendered("overview.md")


def test_a_missing_jinja2_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def without(name: str) -> ModuleType:
        raise ImportError(name)

    templates._environment.cache_clear()
    monkeypatch.setattr(importlib, "import_module", without)
    with pytest.raises(UsageError, match=r"airzoo-bench\[leaderboard\]"):
        templates.rendered("terms.md")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return make("retrieval", tmp_path_factory.mktemp("made"))


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        (["--per-day", "5", "--in-all", "2"], "fewer than 5 a day"),
        (["--data", "nowhere"], "no such folder"),
    ],
)
def test_faults_of_the_user_write_nothing(
    changes: list[str],
    fault: str,
    made: Made,
    tmp_path: object,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = f"{tmp_path}/out"
    arguments = [*made.arguments, "--docker-image", IMAGE, "--out", out, *changes]
    assert run_main("export", "codabench", *arguments) == 2
    assert fault in capsys.readouterr().err


def test_an_unknown_protocol_is_said(
    made: Made, tmp_path: object, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["made-retrival", *made.arguments[1:], "--out", f"{tmp_path}/out"]
    assert run_main("export", "evalai", *arguments) == 2
    assert "made-retrieval" in capsys.readouterr().err
