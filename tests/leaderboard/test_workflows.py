"""``leaderboard init``, and what the workflows of boards must be and must not hold."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.sandbox import Limits, call_limited
from airzoo_bench.leaderboard.board import read_board
from tests.support import ROOT, run_main

yaml = pytest.importorskip("yaml")

STARTER, OWN = ROOT / "airzoo_bench/leaderboard/starter/_github", ROOT / ".github"
TEXTS = {path.name: path.read_text(encoding="utf-8") for path in OWN.glob("workflows/*")}
FOUND = {name: yaml.safe_load(text) for name, text in TEXTS.items()}
WRITING = [set(), {"contents"}, {"pull-requests"}, {"pages", "id-token"}, {"id-token"}]


def test_few_jobs_write_and_the_key_is_in_one_step() -> None:
    """That actions are pinned, and no text of strangers is in a command, zizmor checks: .ci/run."""
    for name, text in TEXTS.items():
        assert {*re.findall(r"uses: *([^/]*)/", text)} <= {"actions", "pypa"}
        assert not re.search(r"allow-unsafe-pr-checkout|head[._](ref|sha)", text)
        top = FOUND[name]["permissions"]
        assert top in ({}, {"contents": "read"})
        for job in FOUND[name]["jobs"].values():
            rights = job.get("permissions", top)
            assert {key for key, level in rights.items() if level == "write"} in WRITING, name
    # Jobs that read pull requests cannot write; the key is in one step, without network.
    board = FOUND["leaderboard.yml"]
    assert [*board[True]] == ["pull_request_target"]  # YAML's "on"
    assert board["concurrency"]["group"].endswith("github.event.pull_request.number }}")
    for name in ("score", "sealed"):
        assert board["jobs"][name]["permissions"] == {"contents": "read"}
        assert board["jobs"][name]["environment"]
    assert TEXTS["leaderboard.yml"].count("secrets.") == 1
    [step] = [one for one in board["jobs"]["sealed"]["steps"] if "AIRZOO_BENCH_KEY" in str(one)]
    assert "unshare --net" in step["run"]


def test_own_board_has_the_workflows_of_every_board() -> None:
    for name in ("workflows/leaderboard.yml", "workflows/board.yml", "zizmor.yml"):
        own = (OWN / name).read_text(encoding="utf-8")
        without_docs = re.sub(r", docs/\*\*|\n *# The documentation.*\n.*", "", own)
        assert without_docs == (STARTER / name).read_text(encoding="utf-8")


def test_every_command_and_option_exists() -> None:
    jobs = [job for found in FOUND.values() for job in found["jobs"].values()]
    lines = "\n".join(step.get("run", "") for job in jobs for step in job["steps"])
    calls = re.findall(r'airzoo-bench[")]* ([^|>\n]+)', lines.replace("\\\n", " "))
    assert len(calls) > 6
    for call in calls:
        assert run_main(*call.split(), "--help") == 0


def test_init_writes_a_board_that_can_be_read(tmp_path: Path) -> None:
    """That it replaces no file is in tests/goldens/refusals.txt."""
    assert run_main("leaderboard", "init", tmp_path / "a", "--repository", "lab/x-1") == 0
    assert run_main("leaderboard", "init", tmp_path / "b") == 0
    named, bare = (read_board(tmp_path / name / "leaderboard.toml") for name in "ab")
    assert (named.url, named.repository) == ("https://lab.github.io/x-1/", "lab/x-1")
    assert bare.repository is None
    (tmp_path / "data/airzoo-mini").mkdir(parents=True)  # data that are there are not made again
    environment = {"PATH": "/usr/bin:/bin", "AIRZOO_BENCH_DATA": str(tmp_path / "data")}
    subprocess.run([tmp_path / "a/.ci/get-data"], check=True, env=environment)


def look(path: str) -> list[str]:
    """Return what a child sees: predictions, files beside them, variables, and networks."""
    beside = [file.name for file in Path(path).parent.iterdir()]
    networks = ["network" for _, name in socket.if_nameindex() if name != "lo"]
    return [Path(path).read_text(), *beside, *os.environ, *networks]


def test_the_container_shows_predictions_and_nothing_else(tmp_path: Path, monkeypatch: Any) -> None:
    if subprocess.run("bwrap --unshare-all --ro-bind / / true", shell=True, check=False).returncode:
        pytest.skip("bwrap is not installed (Debian: bubblewrap), or may make no namespaces here")
    # Where the programs of this machine lie, which on GitHub are in /usr and /opt.
    library, base = sysconfig.get_paths()["purelib"], Path(sys.executable).resolve().parents[1]
    places = [sys.prefix, library, base, ROOT / "airzoo_bench", ROOT / "tests"]
    mounts = " ".join(f"--ro-bind {place} {place}" for place in sorted(map(str, places)))
    command = FOUND["leaderboard.yml"]["env"]["AIRZOO_BENCH_CONTAINER"]
    command = command.replace("--tmpfs /tmp", f"--tmpfs /tmp {mounts}")
    secrets = {"GIT_TOKEN": "x", "AIRZOO_BENCH_KEY": "x"}
    for name, value in (secrets | {"AIRZOO_BENCH_CONTAINER": command}).items():
        monkeypatch.setenv(name, value)
    for name in ("predictions", "other"):
        (tmp_path / name).write_text(name)
    (work := tmp_path / "work").mkdir()
    path, limits = tmp_path / "predictions", Limits(1 << 30)
    call, given = f"{__name__}:look", {"path": str(path)}
    seen = call_limited(call, given, where=path, limits=limits, folder=work)
    assert seen[0] == "predictions"
    assert not {"other", "network", *secrets} & {*seen}
