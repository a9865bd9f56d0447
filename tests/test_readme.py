"""Commands of the README and of pages, as a newcomer types them, and what they print."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[1]
# `sh`, and `python` with imports, run unless a comment is above; `console` shows what it prints.
BLOCK = re.compile(r"(?sm)(?<!-->\n)^```(sh|console|csv|python(?=\nimport))\n(.*?)^```")
SHELL = f"""set -eu
pip() {{ :; }}
python() {{ {sys.executable} "$@"; }}
airzoo-bench() {{ {sys.executable} -m airzoo_bench "$@"; }}
export COLUMNS=100 AIRZOO_BENCH_DATA=data
"""


def run(command: str, folder: Path, *allowed: int) -> str:
    ask = ["bash", "-c", SHELL + command]
    done = subprocess.run(ask, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode in {0, *allowed}, (command, done.stderr)
    return "\n".join(line.rstrip() for line in done.stdout.splitlines())


def follow(page: str, folder: Path) -> None:
    """Run the blocks of a page in their order."""
    for kind, block in BLOCK.findall((PROJECT / page).read_text("utf-8")):
        if kind == "csv":
            (folder / "table.csv").write_text(block, encoding="utf-8")
        elif kind == "sh":
            run(block, folder)
        elif kind == "python":
            run(f"python <<'END'\n{block}END\nairzoo-bench check preds.npz", folder)
        else:
            command, printed = re.findall(r"^\$ ((?:[^\n]*\\\n)*[^\n]*)\n(.*)", block, re.DOTALL)[0]
            assert run(command, folder, 1).strip() == printed.strip(), page


@pytest.mark.slow
def test_pages_print_what_they_show(tmp_path: Path) -> None:
    names = ("index", "retrieval", "matching", "reconstruction", "statistics", "compare", "audit")
    (tmp_path / "protocols").symlink_to(PROJECT / "protocols")
    for page in (*(f"docs/{name}.md" for name in names), "README.md"):
        follow(page, tmp_path)
        run("rm -rf preds*", tmp_path)  # examples that the next page writes anew


@pytest.mark.slow
def test_the_real_scene_prints_what_its_pages_show(tmp_path: Path, brighton: Path) -> None:
    (tmp_path / "brighton").symlink_to(brighton.resolve())
    (tmp_path / "examples").symlink_to(PROJECT / "examples")
    follow("docs/brighton.md", tmp_path)
    methods = r"`(python examples/(\w+?)_.* (\S+))` \| .*?(\d+\.\d\d)"
    for found in re.findall(methods, (PROJECT / "docs" / "python.md").read_text("utf-8")):
        run(found[0], tmp_path)
        assert found[3] in run("airzoo-bench eval {1} {2}".format(*found), tmp_path)


@pytest.mark.slow
def test_the_first_command_installs_the_package_and_scores_every_track(tmp_path: Path) -> None:
    readme = (PROJECT / "README.md").read_text("utf-8")
    [command] = re.findall(r"<!-- try -->\n```sh\n(.*?)```", readme, re.DOTALL)
    copy = tmp_path / "checkout"
    shutil.copytree(PROJECT, copy, ignore=shutil.ignore_patterns(".*", "tests", "docs"))
    ask = ["bash", "-euc", command]
    printed = subprocess.run(ask, cwd=copy, stdout=subprocess.PIPE, text=True, check=True).stdout
    for track in ("retrieval", "matching", "reconstruction"):
        assert f"on airzoo-demo-{track} v" in printed
