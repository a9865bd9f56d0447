"""A reader in a package of its own: the example is installed, listed, and reads."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.readers.retrieval_support import PROTOCOL, Place
from tests.support import HANGS_S

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "reader-package"
_METADATA = "import setuptools.build_meta as b; b.build_sdist('dist')"


def _run(*arguments: object, path: Path | None = None, cwd: Path = ROOT) -> tuple[int, str]:
    places = [str(place) for place in (path, ROOT) if place is not None]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places), "COLUMNS": "200"}
    words = [sys.executable, *map(str, arguments)]
    ran = subprocess.run(
        words,
        env=environment,
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=HANGS_S,
        check=False,
    )
    return ran.returncode, ran.stdout + ran.stderr


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the package without a network; where no wheel can be built, beside its metadata."""
    source = tmp_path_factory.mktemp("source") / "package"
    shutil.copytree(EXAMPLE, source, ignore=shutil.ignore_patterns("*.egg-info", "build", "dist"))
    target = tmp_path_factory.mktemp("target")
    quiet = ("--no-index", "--no-build-isolation", "--no-deps", "--quiet")
    code, said = _run("-m", "pip", "install", *quiet, "--target", target, source)
    if code == 0:
        return target
    code, more = _run("-c", _METADATA, cwd=source)
    if code:
        pytest.skip(f"no build backend that works without a network: {said[-300:]} {more[-300:]}")
    return source / "src"


def test_it_is_listed(installed: Path) -> None:
    code, said = _run("-m", "airzoo_bench", "readers", path=installed)
    assert code == 0, said
    assert "ranks-csv" in said
    assert "ranks.csv of my method" in said
    assert "ranks-csv" not in _run("-m", "airzoo_bench", "readers")[1]


def test_it_reads(installed: Path, tmp_path: Path) -> None:
    place = Place()
    data = place.prepare(tmp_path / "data")
    lines = ["query,tile,similarity"]
    for scene in place.scenes:
        order, scores = place.ranked(scene)
        for query, tiles in enumerate(order.tolist()):
            rows = zip(tiles, scores[query].tolist(), strict=True)
            photo = f"{scene.id}/q{query:05d}.jpg"
            lines += [f"{photo},{scene.tile(tile)},{score!r}" for tile, score in rows]
    (tmp_path / "ranks.csv").write_text("\n".join(lines))
    command = ("eval", "retrieval", tmp_path / "ranks.csv", "--protocol", PROTOCOL, "--data", data)
    code, said = _run("-m", "airzoo_bench", *command, path=installed)
    assert code == 0, said
    assert "read by reader ranks-csv" in said
    assert "100.0" in said
