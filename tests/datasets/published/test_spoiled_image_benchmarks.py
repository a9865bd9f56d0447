"""What is wrong with the trees of benchmarks that give images: one message, and nothing is left."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.datasets.published.image_trees import CHINESE, TREES
from tests.support import run_main


@pytest.fixture(autouse=True)
def _data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))


def _without(relative: str) -> Callable[[Path], None]:
    def spoil(source: Path) -> None:
        path = source / relative
        shutil.rmtree(path) if path.is_dir() else path.unlink()

    return spoil


def _text(relative: str, change: Callable[[str], str]) -> Callable[[Path], None]:
    def spoil(source: Path) -> None:
        path = source / relative
        path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")

    return spoil


def _swapped(text: str) -> str:
    entries = json.loads(text)
    for one in entries:
        one["drone_loc_x_y"].reverse()
    return json.dumps(entries)


def _half(source: Path) -> None:
    (source / "test" / "query_drone" / "0701" / "image-04.jpeg.part").write_bytes(b"")


def _copy(source: Path) -> None:
    home = source / "test" / "gallery_satellite" / "0701"
    shutil.copy(home / "0701.jpg", home / "0701.png")


def _zip(source: Path) -> None:
    shutil.rmtree(source / "test")
    (source / "University-Release.zip").write_bytes(b"PK")


GPS, LIST = "Dense_GPS_ALL.txt", "cross-area-drone2sate-test.json"
SPOILED: dict[str, tuple[str, Callable[[Path], None], tuple[str, ...]]] = {
    "no query folder": (
        "university-1652",
        _without("test/query_satellite"),
        ("query_satellite", "no such folder", "gallery_drone"),
    ),
    "half downloaded": ("university-1652", _half, ("image-04.jpeg.part", "half downloaded")),
    "one name twice": ("university-1652", _copy, ("0701/0701.jpg", "several have one name")),
    "not unpacked": (
        "university-1652",
        _zip,
        ("unpack", "University-Release.zip", "gallery_satel"),
    ),
    "rounded positions": (
        "denseuav",
        _text(GPS, lambda text: re.sub(r"(E\d+\.\d\d)\d+", r"\1", text)),
        (GPS, "4 of 5 classes have the position of another", "rounded"),
    ),
    "x and y swapped": (
        "gta-uav",
        _text(LIST, _swapped),
        ("sides of a tile from the tiles that they overlap", "swapped"),
    ),
    "no positions": ("denseuav", _without(GPS), (GPS, "found: 'test/', 'train/'")),
    "latitude first": (
        "denseuav",
        _text(GPS, lambda text: text.replace("E1", "#1").replace("N3", "E3").replace("#1", "N1")),
        (GPS, "line 1 is", "N120"),
    ),
    "no list": ("gta-uav", _without(LIST), (LIST, "no such list of pairs")),
    "a list cut short": (
        "gta-uav",
        _text(LIST, lambda text: text[:-40]),
        (LIST, "not valid JSON", "cut short"),
    ),
    "a tile is missing": (
        "gta-uav",
        _without("satellite/4_0_6_13.png"),
        ("tiles of the list", "1 of"),
    ),
}


@pytest.mark.parametrize("case", SPOILED)
def test_bad_input_gets_one_message_and_leaves_nothing(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, spoil, words = SPOILED[case]
    source = TREES[name](tmp_path / CHINESE)
    spoil(source)
    assert run_main("prepare", name, "--source", source) == 2
    said = capsys.readouterr().err
    assert said.count("fix:") == 1
    for word in words:
        assert word in " ".join(said.split()), (word, said)
    assert not [path for path in (tmp_path / "data").glob("*") if path.name != ".cache"]


def test_a_source_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in TREES:
        assert run_main("prepare", name, "--source", tmp_path / "nowhere") == 2
        assert "no such folder" in capsys.readouterr().err
