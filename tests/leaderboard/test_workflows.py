"""``leaderboard init``, and what the workflows of boards must be and must not hold."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import pytest
import typer

from airzoo_bench.cli.main import app
from airzoo_bench.core.sandbox import Limits, call_limited
from airzoo_bench.leaderboard.board import read_board
from tests.support import ROOT, run_main

yaml = pytest.importorskip("yaml")

STARTER, OWN = ROOT / "airzoo_bench/leaderboard/starter/_github", ROOT / ".github"
TEXTS = {path.name: path.read_text(encoding="utf-8") for path in OWN.glob("workflows/*")}
FOUND = {name: yaml.safe_load(text) for name, text in TEXTS.items()}
WRITING = [set(), {"contents"}, {"pull-requests"}, {"pages", "id-token"}, {"id-token"}]


def test_few_jobs_write_and_the_key_is_in_one_step() -> None:
    """That no text of strangers is in a command, zizmor checks: see .ci/run."""
    for file, text in TEXTS.items():
        assert {*re.findall(r"uses: *([^/]*)/", text)} <= {"actions", "pypa"}
        assert text.count("uses:") == len(re.findall(r"uses: \S+@[0-9a-f]{40} # v", text))
        for word in (
            "allow-unsafe-pr-checkout",
            "head.ref",
            "head_ref",
            "head.sha",
            "workflow_run",
        ):
            assert word not in text
        top = FOUND[file]["permissions"]
        assert top in ({}, {"contents": "read"})
        for name, job in FOUND[file]["jobs"].items():
            rights = job.get("permissions", top)
            assert {key for key, level in rights.items() if level == "write"} in WRITING, name
            assert job["timeout-minutes"] <= 360
    # Jobs that read pull requests cannot write; the key is in one step, without network.
    board = FOUND["leaderboard.yml"]
    assert list(board[True]) == ["pull_request_target"]  # YAML's "on"
    assert board["permissions"] == {}
    assert board["concurrency"]["group"].endswith("github.event.pull_request.number }}")
    for name in ("score", "sealed"):
        assert board["jobs"][name]["permissions"] == {"contents": "read"}
        assert board["jobs"][name]["environment"]
    assert TEXTS["leaderboard.yml"].count("secrets.") == 1
    steps = board["jobs"]["sealed"]["steps"]
    [step] = [step for step in steps if "AIRZOO_BENCH_KEY" in step.get("env", {})]
    assert "unshare --net" in step["run"]


@pytest.mark.parametrize("name", ["workflows/leaderboard.yml", "workflows/board.yml", "zizmor.yml"])
def test_own_board_has_the_workflows_of_every_board(name: str) -> None:
    own = (OWN / name).read_text(encoding="utf-8")
    without_docs = re.sub(r", docs/\*\*|\n *# The documentation.*\n.*", "", own)
    assert without_docs == (STARTER / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", TEXTS)
def test_every_command_and_option_exists(name: str) -> None:
    steps = [step for job in FOUND[name]["jobs"].values() for step in job["steps"]]
    joined = "\n".join(step.get("run", "") for step in steps).replace("\\\n", " ")
    called = re.findall(r"airzoo-bench(?:\)\")? ((?:leaderboard|submi|seal|baseline).*)", joined)
    assert called or name in {"ci.yml", "nightly.yml", "release.yml"}
    for call in called:
        words = call.split(" || ")[0].split()
        group: Any = typer.main.get_command(app)
        while hasattr(group, "list_commands"):
            group = group.get_command(None, words.pop(0))
        options = {name for one in group.params for name in (*one.opts, *one.secondary_opts)}
        assert {word for word in words if word.startswith("--")} <= options, call


def test_init_writes_a_board_that_can_be_read_and_replaces_no_file(tmp_path: Path) -> None:
    home, own = tmp_path / "b", tmp_path / "own/.github/workflows/board.yml"
    own.parent.mkdir(parents=True)
    own.write_text("mine")
    assert run_main("leaderboard", "init", tmp_path / "own") == 2
    assert [p for p in (tmp_path / "own").rglob("*") if p.is_file()] == [own]
    assert run_main("leaderboard", "init", home, "--repository", "lab/x-1") == 0
    board = read_board(home / "leaderboard.toml")
    assert (board.url, board.repository) == ("https://lab.github.io/x-1/", "lab/x-1")
    assert (home / ".github/workflows/board.yml").is_file()
    (tmp_path / "data/airzoo-mini").mkdir(parents=True)  # data that are there are not made again
    environment = {"PATH": "/usr/bin:/bin", "AIRZOO_BENCH_DATA": str(tmp_path / "data")}
    subprocess.run([home / ".ci/get-data"], check=True, env=environment)
    assert run_main("leaderboard", "init", tmp_path / "c") == 0
    assert read_board(tmp_path / "c/leaderboard.toml").repository is None


def look(path: str, other: str) -> list[str]:
    """Return what a child sees: the predictions, another file, secrets and the network."""
    seen = [Path(path).read_text(), "other" if Path(other).exists() else "", *os.environ]
    return [*seen, *(name for _, name in socket.if_nameindex() if name != "lo")]


def test_the_container_shows_predictions_and_nothing_else(tmp_path: Path, monkeypatch: Any) -> None:
    bwrap = ["bwrap", "--unshare-all", "--ro-bind", "/", "/", "true"]
    if shutil.which("bwrap") is None or subprocess.run(bwrap, check=False).returncode:
        pytest.skip("bwrap is not installed (Debian: bubblewrap), or may make no namespaces here")
    # Where the programs of this machine lie, which on GitHub are in /usr and /opt.
    base, library = Path(sys.executable).resolve().parents[1], sysconfig.get_paths()["purelib"]
    places = [*sorted({sys.prefix, str(base), library, str(ROOT / "airzoo_bench")}), ROOT / "tests"]
    mounts = " ".join(f"--ro-bind {place} {place}" for place in places)
    command = FOUND["leaderboard.yml"]["env"]["AIRZOO_BENCH_CONTAINER"]
    command = command.replace("--tmpfs /tmp", f"--tmpfs /tmp {mounts}")
    monkeypatch.setenv("AIRZOO_BENCH_CONTAINER", command)
    for name in ("GIT_TOKEN", "AIRZOO_BENCH_KEY"):
        monkeypatch.setenv(name, "secret")
    predictions, other, work = (tmp_path / name for name in ("preds", "other", "work"))
    predictions.write_text("predictions")
    other.write_text("secret")
    work.mkdir()
    given, limits = {"path": str(predictions), "other": str(other)}, Limits(1 << 30)
    call = f"{__name__}:look"
    seen = call_limited(call, given, where=predictions, limits=limits, folder=work)
    assert seen[:2] == ["predictions", ""]
    assert not {"GIT_TOKEN", "AIRZOO_BENCH_KEY", "eth0"} & set(seen)
