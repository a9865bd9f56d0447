"""A board built again, the same bytes and whole or not at all, and served."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.leaderboard.site.support import built, files_of, method, some_runs, write_version
from tests.support import HANGS_S


def test_the_same_bytes_from_nothing_from_a_cache_and_in_any_order(
    root: Path, tmp_path: Path
) -> None:
    expected = files_of(root / "site")
    shutil.copytree(root / "runs", tmp_path / "runs", copy_function=shutil.copy)
    moved = sorted((tmp_path / "runs/made/retrieval").iterdir(), reverse=True)
    for path in moved:  # entries come back in another order
        path.rename(path.with_name(f"{path.name}~")).rename(path)
    write_version(tmp_path / "runs", "m1", 2, method("Method 1", 0.9))
    built(tmp_path)  # fills the cache, with a method that is not on the board later
    shutil.rmtree(tmp_path / "runs/made/retrieval/m1/2")
    assert files_of(built(tmp_path)) == expected
    assert files_of(built(tmp_path, out="other")) == expected


def flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.parametrize("damage", [flipped, lambda content: b""])
def test_a_damaged_cache_gives_no_other_page(
    root: Path, tmp_path: Path, damage: Callable[[bytes], bytes]
) -> None:
    shutil.copytree(root / "runs", tmp_path / "runs")
    built(tmp_path)
    write_version(tmp_path / "runs", "m1", 2, method("Method 1", 0.9))
    expected = files_of(built(tmp_path, "whole"))
    kept = [*(tmp_path / "site.cache").glob("*.npz")]
    assert kept
    for path in kept:
        path.write_bytes(damage(path.read_bytes()))
    assert files_of(built(tmp_path)) == expected


def test_serving_a_built_site(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 1)
    site = built(tmp_path)
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[3]), *sys.path])
    }
    serve = [sys.executable, "-m", "airzoo_bench", "leaderboard", "serve", str(site), "--port", "0"]
    with subprocess.Popen(
        serve, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.match(r"http://127\.0\.0\.1:\d+/", line)
        assert found, line
        address = found[0]
        with urllib.request.urlopen(f"{address}board.json") as answer:
            assert json.load(answer)["title"] == "A board"
        with urllib.request.urlopen(address) as answer:
            assert b"A board" in answer.read()
        for path in ("../secret", "%2e%2e/secret", "nothing"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(address + path)
        with pytest.raises(urllib.error.HTTPError, match="501"):
            urllib.request.urlopen(urllib.request.Request(address, b"x", method="PUT"))
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=HANGS_S)
    assert (process.returncode, said) == (0, "")
