"""Example packages: on the search path of this process, or installed without a network."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.support import HANGS_S

ROOT = Path(__file__).resolve().parents[1]


def add_package(example: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Put a package's source and entry points, as an installed one has them, on the path."""
    project = tomllib.loads((example / "pyproject.toml").read_text())["project"]
    shutil.copytree(example / "src", folder)
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    stated = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (info / "METADATA").write_text(stated)
    lines = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {place}" for name, place in points.items())]
    (info / "entry_points.txt").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(folder)


def listed_when_installed(example: Path, home: Path, *command: str) -> str:
    """Install a package, and return what a command prints in a process that sees it."""
    source, target = home / "package", home / "target"
    shutil.copytree(example, source, ignore=shutil.ignore_patterns("*.egg-info", "build", "dist"))
    _run("-m", "pip", "install", "--no-deps", "--quiet", "--target", target, source)
    return _run("-m", "airzoo_bench", *command, path=target)


def _run(*arguments: object, path: Path = ROOT) -> str:
    environment = os.environ | {"PYTHONPATH": f"{path}{os.pathsep}{ROOT}", "COLUMNS": "200"}
    words = [sys.executable, *map(str, arguments)]
    done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=HANGS_S)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
