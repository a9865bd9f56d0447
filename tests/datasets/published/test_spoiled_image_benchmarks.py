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


def _two(source: Path) -> None:
    for name in "ab":
        shutil.copytree(source / "test", source / name / "test")
    shutil.rmtree(source / "test")


def _zip(source: Path) -> None:
    shutil.rmtree(source / "test")
    (source / "University-Release.zip").write_bytes(b"PK")


def _no_class(source: Path) -> None:
    (source / "test" / "query_drone" / "0701").rename(source / "test" / "query_drone" / "library")


def _empty(source: Path) -> None:
    (source / "test" / "gallery_satellite" / "0701" / "0701.jpg").unlink()


GPS, LIST = "Dense_GPS_ALL.txt", "cross-area-drone2sate-test.json"
SPOILED: dict[str, tuple[str, Callable[[Path], None], tuple[str, ...]]] = {
    "no query folder": (
        "university-1652",
        _without("test/query_satellite"),
        ("query_satellite", "no such folder", "gallery_drone"),
    ),
    "no class in the gallery": (
        "university-1652",
        _without("test/gallery_satellite/0703"),
        ("gallery_satellite", "1 class of the queries without an image", "703"),
    ),
    "half downloaded": ("university-1652", _half, ("image-04.jpeg.part", "half downloaded")),
    "one name twice": ("university-1652", _copy, ("0701/0701.jpg", "several have one name")),
    "two benchmarks": ("university-1652", _two, ("several folders", "--source")),
    "not unpacked": (
        "university-1652",
        _zip,
        ("unpack", "University-Release.zip", "gallery_satel"),
    ),
    "a folder that is no class": ("university-1652", _no_class, ("'library'", "whole numbers")),
    "an empty class": ("university-1652", _empty, ("class folders without an image", "0701")),
    "a file of 0 bytes": (
        "university-1652",
        lambda source: (source / "test/query_satellite/0701/0701.jpg").write_bytes(b"") and None,
        ("0701", "files of 0 bytes: 1 (0701.jpg)"),
    ),
    "rounded positions": (
        "denseuav",
        _text(GPS, lambda text: re.sub(r"(E\d+\.\d\d)\d+", r"\1", text)),
        (GPS, "4 of 5 classes have the position of another", "rounded"),
    ),
    "west of Greenwich": (
        "denseuav",
        _text(GPS, lambda text: text.replace("E120", "E-120")),
        (GPS, "line 1 is", "E-120.387"),
    ),
    "positions far apart": (
        "denseuav",
        _text(GPS, lambda text: re.sub(r"E120\.38(\d)(\d)", r"E12\2.38\1", text)),
        (GPS, "m from the next one (median)"),
    ),
    "x and y swapped": (
        "gta-uav",
        _text(LIST, _swapped),
        ("sides of a tile from the tiles that they overlap", "swapped"),
    ),
    "no positions": ("denseuav", _without(GPS), (GPS, "found: 'test/', 'train/'")),
    "decimal commas": (
        "denseuav",
        _text(GPS, lambda text: text.replace("E120.", "E120,")),
        (GPS, "line 1 is", "E120,387", "points"),
    ),
    "latitude first": (
        "denseuav",
        _text(GPS, lambda text: text.replace("E1", "#1").replace("N3", "E3").replace("#1", "N1")),
        (GPS, "line 1 is", "N120"),
    ),
    "commas between": (
        "denseuav",
        _text(GPS, lambda text: text.replace(" ", ",")),
        (GPS, "line 1", "blanks"),
    ),
    "a class without a line": (
        "denseuav",
        _text(GPS, lambda text: text.replace("/002256/", "/009999/")),
        (GPS, "no position of classes", "2256"),
    ),
    "no list": ("gta-uav", _without(LIST), (LIST, "no such list of pairs")),
    "a list cut short": (
        "gta-uav",
        _text(LIST, lambda text: text[:-40]),
        (LIST, "not valid JSON", "cut short"),
    ),
    "another key": (
        "gta-uav",
        _text(LIST, lambda text: text.replace("drone_loc_x_y", "drone_loc_lat_lon")),
        (LIST, "entry 1 lacks drone_loc_x_y", "drone_loc_lat_lon"),
    ),
    "a name that leaves the folder": (
        "gta-uav",
        _text(LIST, lambda text: text.replace("drone/images", "../images")),
        (LIST, "names of files"),
    ),
    "a weight beyond 1": (
        "gta-uav",
        _text(LIST, lambda text: text.replace("0.6", "1.6")),
        (LIST, "entry 1", "1.6"),
    ),
    "not a number": (
        "gta-uav",
        _text(LIST, lambda text: text.replace("0.6", "NaN")),
        (LIST, "entry 1", "a weight from 0 to 1"),
    ),
    "a tile elsewhere": (
        "gta-uav",
        _text(LIST, lambda text: text.replace("9331.2", "9331.9")),
        ("4_0_6_13.png", "from where its name says"),
    ),
    "a tile is missing": (
        "gta-uav",
        _without("satellite/4_0_6_13.png"),
        ("tiles of the list", "1 of"),
    ),
    "a tile that only the positive ones name is missing": (
        "gta-uav",
        _text(LIST, lambda text: text.replace('["4_0_6_12.png"', '["4_0_6_31.png"', 1)),
        ("tiles of the list", "4_0_6_31.png"),
    ),
    "a number that no float holds": (
        "gta-uav",
        _text(LIST, lambda text: text.replace("4522.8", "1" + "0" * 400)),
        (LIST, "entry 1", "drone_loc_x_y is none"),
    ),
    "an image is missing": (
        "gta-uav",
        _without("drone/images/200_0002_0000000001.png"),
        ("drone images of the list are missing", "200_0002"),
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
