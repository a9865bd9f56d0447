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
from tests.support import run_main

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).resolve().parents[2]
STARTER = ROOT / "airzoo_bench" / "leaderboard" / "starter"
STARTED = STARTER / "_github" / "workflows"
WORKFLOWS = sorted([*(ROOT / ".github" / "workflows").glob("*.y*ml"), *STARTED.glob("*.yml")])
LEADERBOARD = STARTED / "leaderboard.yml"


def loaded(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def steps(path: Path) -> list[dict[str, Any]]:
    return [step for job in loaded(path)["jobs"].values() for step in job["steps"]]


@pytest.mark.parametrize("path", WORKFLOWS, ids=str)
def test_nothing_of_strangers_is_run_and_few_jobs_write(path: Path) -> None:
    """That actions are pinned, and that no text of strangers is in a command, zizmor checks."""
    text = path.read_text(encoding="utf-8")
    assert {*re.findall(r"uses: *([^/]*)/", text)} <= {"actions", "pypa"}
    for word in ("allow-unsafe-pr-checkout", "head.ref", "head_ref", "head.sha", "workflow_run"):
        assert word not in text
    top = loaded(path)["permissions"]
    assert top in ({}, {"contents": "read"})
    for name, job in loaded(path)["jobs"].items():
        rights = job.get("permissions", top)
        writing = {key for key, level in rights.items() if level == "write"}
        allowed = ((), ("contents",), ("pull-requests",), ("pages", "id-token"), ("id-token",))
        assert writing in map(set, allowed), name
        assert job["timeout-minutes"] <= 360


def test_rights_and_the_key() -> None:
    """Jobs that read pull requests cannot write; the key is in one step, without network."""
    found = loaded(LEADERBOARD)
    assert list(found[True]) == ["pull_request_target"]  # YAML's "on"
    assert found["permissions"] == {}
    assert found["concurrency"]["group"].endswith("github.event.pull_request.number }}")
    for name in ("score", "sealed"):
        assert found["jobs"][name]["permissions"] == {"contents": "read"}
        assert found["jobs"][name]["environment"]
    assert LEADERBOARD.read_text(encoding="utf-8").count("secrets.") == 1
    [step] = [s for s in steps(LEADERBOARD) if "AIRZOO_BENCH_KEY" in s.get("env", {})]
    assert "unshare --net" in step["run"]
    assert step in found["jobs"]["sealed"]["steps"]


@pytest.mark.parametrize("name", ["workflows/leaderboard.yml", "workflows/board.yml", "zizmor.yml"])
def test_own_board_has_the_workflows_of_every_board(name: str) -> None:
    own = (ROOT / ".github" / name).read_text(encoding="utf-8")
    without_docs = re.sub(r", docs/\*\*|\n *# The documentation.*\n.*", "", own)
    assert without_docs == (STARTER / "_github" / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("path", WORKFLOWS, ids=str)
def test_every_command_and_option_exists(path: Path) -> None:
    joined = "\n".join(step.get("run", "") for step in steps(path)).replace("\\\n", " ")
    called = re.findall(r"airzoo-bench(?:\)\")? ((?:leaderboard|submi|seal|baseline).*)", joined)
    assert called or path.name in {"ci.yml", "nightly.yml", "release.yml"}
    for call in called:
        words = call.split(" || ")[0].split()
        group: Any = typer.main.get_command(app)
        while hasattr(group, "list_commands"):
            group = group.get_command(None, words.pop(0))
        options = {name for one in group.params for name in (*one.opts, *one.secondary_opts)}
        assert {word for word in words if word.startswith("--")} <= options, call


def test_zizmor_finds_nothing_in_the_workflows() -> None:
    places = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    if (program := shutil.which("zizmor", path=places)) is None:
        pytest.skip("zizmor, of airzoo-bench[dev], is not there")
    line = [program, "--offline", "--no-progress", ROOT / ".github"]
    done = subprocess.run(line, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_init_writes_a_board_that_can_be_read_and_replaces_no_file(tmp_path: Path) -> None:
    home, own = tmp_path / "b", tmp_path / "own/.github/workflows/board.yml"
    own.parent.mkdir(parents=True)
    own.write_text("mine")
    assert run_main("leaderboard", "init", tmp_path / "own") == 2
    assert [p for p in (tmp_path / "own").rglob("*") if p.is_file()] == [own]
    assert run_main("leaderboard", "init", home, "--repository", "lab/x-1") == 0
    board = read_board(home / "leaderboard.toml")
    assert (board.url, board.repository) == ("https://lab.github.io/x-1/", "lab/x-1")
    assert (home / ".github" / "workflows" / "board.yml").is_file()
    (tmp_path / "data/airzoo-mini").mkdir(parents=True)  # data that are there are not made again
    environment = {"PATH": "/usr/bin:/bin", "AIRZOO_BENCH_DATA": str(tmp_path / "data")}
    subprocess.run([home / ".ci" / "get-data"], check=True, env=environment)
    assert run_main("leaderboard", "init", tmp_path / "c") == 0
    assert read_board(tmp_path / "c" / "leaderboard.toml").repository is None


# --- the container of the workflows, in which a child reads what strangers wrote ---


def look(path: str, other: str) -> list[str]:
    """Return what a child sees: the predictions, another file, secrets and the network."""
    seen = [Path(path).read_text(), "other" if Path(other).exists() else "", *os.environ]
    return [*seen, *(name for _, name in socket.if_nameindex() if name != "lo")]


def test_the_container_of_the_workflows_reads_predictions_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bwrap = ["bwrap", "--unshare-all", "--ro-bind", "/", "/", "true"]
    if shutil.which("bwrap") is None or subprocess.run(bwrap, check=False).returncode:
        pytest.skip("bwrap is not installed (Debian: bubblewrap), or may make no namespaces here")
    command = yaml.safe_load(LEADERBOARD.read_text())["env"]["AIRZOO_BENCH_CONTAINER"]
    # Where the programs of this machine lie, which on GitHub are in /usr and /opt.
    base = Path(sys.executable).resolve().parents[1]
    places = {sys.prefix, str(base), sysconfig.get_paths()["purelib"], str(ROOT / "airzoo_bench")}
    mounts = " ".join(f"--ro-bind {place} {place}" for place in [*sorted(places), ROOT / "tests"])
    command = command.replace("--tmpfs /tmp", f"--tmpfs /tmp {mounts}")
    predictions, other, work = tmp_path / "preds", tmp_path / "other", tmp_path / "work"
    predictions.write_text("predictions")
    other.write_text("secret")
    work.mkdir()
    monkeypatch.setenv("AIRZOO_BENCH_CONTAINER", command)
    for name in ("GIT_TOKEN", "AIRZOO_BENCH_KEY"):
        monkeypatch.setenv(name, "secret")
    given, limits = {"path": str(predictions), "other": str(other)}, Limits(1 << 30)
    call = f"{__name__}:look"
    seen = call_limited(call, given, where=predictions, limits=limits, folder=work)
    assert seen[:2] == ["predictions", ""]
    assert not {"GIT_TOKEN", "AIRZOO_BENCH_KEY", "eth0"} & set(seen)
