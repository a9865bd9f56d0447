"""A built board, served."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from airzoo_bench.core.errors import UserError
from tests.leaderboard.site.support import (
    built,
    some_runs,
)
from tests.support import HANGS_S


def test_serving_a_built_site(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 1)
    site = built(tmp_path)
    (tmp_path / "secret").write_text("secret")
    (site / "link").symlink_to(tmp_path / "secret")
    places = [str(Path(__file__).parents[3]), *sys.path]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places)}
    serve = ["-m", "airzoo_bench", "leaderboard", "serve", str(site), "--port", "0"]
    with subprocess.Popen(
        [sys.executable, *serve],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.match(r"http://127\.0\.0\.1:\d+/", line)
        assert found, line
        address = found[0]
        with urllib.request.urlopen(f"{address}api/v1/board.json") as answer:
            assert json.load(answer)["title"] == "A board"
        with urllib.request.urlopen(address) as answer:
            assert b"A board" in answer.read()
        for path in ("../secret", "%2e%2e/secret", "link", "nothing", "api/"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(address + path)
        with pytest.raises(urllib.error.HTTPError, match="501"):
            urllib.request.urlopen(urllib.request.Request(address, b"x", method="PUT"))
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=HANGS_S)
    assert process.returncode == 0
    assert said == ""


def test_what_is_no_site_is_not_served(tmp_path: Path) -> None:
    from airzoo_bench.leaderboard.site.serving import serve_folder

    with pytest.raises(UserError, match="not the site of a board"):
        serve_folder(tmp_path, 0, print)
