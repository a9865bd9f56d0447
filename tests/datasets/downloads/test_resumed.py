"""`download` gone on with: only the bytes that lack are fetched, and damage is found."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.datasets.downloads.hub_place import FILES, part_of, parts, there
from tests.datasets.downloads.hub_server import Hub
from tests.support import run_main


def test_a_newer_version_replaces_what_this_fetched(hub: Hub, place: Path) -> None:
    assert run_main("download", "park") == 0
    hub.files["README.md"] = b"about it"
    hub.asked.clear()
    assert run_main("download", "park") == 0
    assert hub.fetched() == [("README.md", None)]
    assert there(place / "park") == hub.files


def test_a_file_that_was_changed_since_is_refused(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("download", "park") == 0
    (place / "park" / "README.md").write_bytes(b"About")
    assert run_main("download", "park") == 2
    assert "'README.md'" in capsys.readouterr().err


def test_only_the_bytes_that_lack_are_fetched(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = part_of(place / "park", "01/drone images.zip")
    part.parent.mkdir(parents=True)
    part.write_bytes(FILES["01/drone images.zip"][:7000])
    assert run_main("download", "park") == 0
    assert ("01/drone images.zip", "bytes=7000-") in hub.fetched()
    assert there(place / "park") == FILES
    assert "to fetch, 3.85 kB" in capsys.readouterr().err


def test_a_cut_connection_is_gone_on_with(hub: Hub, place: Path) -> None:
    hub.cut["01/drone images.zip"] = 5000
    assert run_main("download", "park") == 0
    spans = [span for name, span in hub.fetched() if name == "01/drone images.zip"]
    assert spans[0] is None
    assert there(place / "park") == FILES


def test_what_was_begun_wrong_is_fetched_anew(hub: Hub, place: Path) -> None:
    part = part_of(place / "park", "01/drone images.zip")
    part.parent.mkdir(parents=True)
    part.write_bytes(b"?" * 7000)
    assert run_main("download", "park") == 0
    spans = [span for name, span in hub.fetched() if name == "01/drone images.zip"]
    assert spans == ["bytes=7000-", None]
    assert there(place / "park") == FILES


@pytest.mark.parametrize("name", ["01/drone images.zip", "README.md"])
def test_a_damaged_file_does_not_appear(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    hub.wrong.add(name)
    assert run_main("download", "park") == 2
    assert f"{name} is damaged: what came is not what the dataset's list" in capsys.readouterr().err
    assert name not in there(place / "park")
    assert parts(place / "park") == []
    hub.wrong.clear()
    assert run_main("download", "park") == 0
    assert there(place / "park") == FILES


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is full")
def test_a_full_disk_keeps_what_is_there(
    hub: Hub, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = part_of(place / "park", "02/drone images.zip")
    part.parent.mkdir(parents=True)
    part.symlink_to("/dev/full")
    assert run_main("download", "park") == 2
    said = capsys.readouterr().err
    assert "the disk is full" in said
    assert "make room and run this again: what is there is kept" in said
    assert set(there(place / "park")) == {"01/drone images.zip"}


def test_a_damaged_record_is_left_aside(hub: Hub, place: Path) -> None:
    assert run_main("download", "park") == 0
    record = place / "park" / ".airzoo-bench" / "verified.json"
    for text in ("{", "[]", '{"README.md": 3}'):
        record.write_text(text)
        hub.asked.clear()
        assert run_main("download", "park") == 0
        assert hub.fetched() == []
    assert set(json.loads(record.read_text())) == set(FILES)


RUN = """
import sys
from airzoo_bench.cli.main import main
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About
from types import SimpleNamespace
about = About("Park", "A made-up dataset.", "park", "https://park", "CC0", repository="who/park")
DATASETS.add("park", SimpleNamespace(about=about, is_published=True))
sys.argv = ["airzoo-bench", "download", "park"]
main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_after_ctrl_c_another_run_goes_on(hub: Hub, place: Path) -> None:
    big = os.urandom(1 << 20) * 64
    hub.files = {"big.bin": big}
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen([sys.executable, "-c", RUN], env=environment, cwd=place) as run:
        while not any(path.stat().st_size for path in parts(place / "park")):
            time.sleep(0.002)
            if run.poll() is not None:
                break
        run.send_signal(signal.SIGINT)
    if run.returncode == 0:
        pytest.skip("it was done before it could be stopped")
    assert run.returncode == 130
    (part,) = parts(place / "park")
    begun = part.stat().st_size
    assert 0 < begun < len(big)
    hub.asked.clear()
    assert run_main_of_all("park") == 0
    assert hub.fetched() == [("big.bin", f"bytes={begun}-")]
    assert (place / "park" / "big.bin").read_bytes() == big


def run_main_of_all(*arguments: Any) -> int:
    return run_main("download", *arguments)
