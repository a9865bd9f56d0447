"""Example packages, installed without a network, and commands that see them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import HANGS_S

ROOT = Path(__file__).resolve().parents[1]
_METADATA = "import setuptools.build_meta as b; b.build_sdist('dist')"


def run_python(*arguments: object, path: Path | None = None, cwd: Path = ROOT) -> tuple[int, str]:
    """Run Python with the checkout and a package on its path; return exit code and output."""
    places = [str(place) for place in (path, ROOT) if place is not None]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places), "COLUMNS": "200"}
    words = [sys.executable, *map(str, arguments)]
    settings = {"env": environment, "cwd": cwd, "timeout": HANGS_S}
    ran = subprocess.run(words, capture_output=True, text=True, check=False, **settings)
    return ran.returncode, ran.stdout + ran.stderr


def install(example: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install a package; where no wheel can be built, return its source beside its metadata."""
    source = tmp_path_factory.mktemp("source") / "package"
    shutil.copytree(example, source, ignore=shutil.ignore_patterns("*.egg-info", "build", "dist"))
    target = tmp_path_factory.mktemp("target")
    quiet = ("--no-index", "--no-build-isolation", "--no-deps", "--quiet")
    code, said = run_python("-m", "pip", "install", *quiet, "--target", target, source)
    if code == 0:
        return target
    code, more = run_python("-c", _METADATA, cwd=source)
    if code:
        pytest.skip(f"no build backend that works without a network: {said[-300:]} {more[-300:]}")
    return source / "src"
