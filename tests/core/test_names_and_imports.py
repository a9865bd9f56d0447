"""Registries of names, keys that nobody knows, lines about long work, and light imports."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from threading import Event
from typing import TypeVar

import matplotlib
import pytest

from airzoo_bench.cli.progress import report_progress
from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.progress import Headed, with_progress
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import Strict, nearest, validated
from airzoo_bench.report.figures import default_style, figure_bytes, new_canvas
from tests.support import HANGS_S

T = TypeVar("T")


def test_a_package_adds_names(tmp_path, monkeypatch, caplog) -> None:
    info = tmp_path / "more-tracks-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: more-tracks\nVersion: 1.0\n")
    own = ("depth = pathlib:Path", "fine = airzoo_bench.matching.info:INFO", "gone = no_module:X")
    lines = ["[airzoo_bench.tracks]", *own, "matching = pathlib:Path"]
    (info / "entry_points.txt").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(tmp_path)
    assert TRACKS.names() == ["retrieval", "matching", "reconstruction", "depth", "fine", "gone"]
    assert "track matching (package more-tracks)" in caplog.text
    assert TRACKS.get("fine") is TRACKS.get("matching")
    assert {*TRACKS.load_all()} == {"retrieval", "matching", "reconstruction", "fine"}
    for broken in ("depth", "gone"):
        assert f"track {broken} (package more-tracks)" in caplog.text
        with pytest.raises(UserError):
            TRACKS.get(broken)
    with pytest.raises(KeyError):
        TRACKS.get("none")


@pytest.mark.parametrize(
    ("name", "near"), [("UAV_VisLoc", "uav-visloc"), ("7", "07"), ("xyz", ""), ("SAM", "sam")]
)
def test_names_like_a_mistyped_one(name: str, near: str) -> None:
    offered = nearest(name, ["uav-visloc", "07", "sam", "aerialextrematch"])
    assert offered.split("'")[1::2] == ([near] if near else [])


@pytest.mark.parametrize("key", ["<map>", "plain"])
def test_a_key_that_nobody_knows_is_named_whatever_it_is(key: str) -> None:
    class Table(Strict):
        known: int = 1

    with pytest.raises(SubmissionError, match=f"unknown key '{key}'"):
        validated({key: 1}, Table, SubmissionError, Path("x.toml"), "table")


def test_a_line_every_half_minute() -> None:
    times, said = iter((0, 10, 29, 31, 40, 210, 220)), list[str]()
    items = report_progress("abcdef", "poses", 6, say=said.append, clock=lambda: next(times))
    assert list(items) == list("abcdef")
    # After 31 s three of six are done, after 210 s five; the lines between come too soon.
    assert [line.partition(",")[0] for line in said] == ["poses: 3 of 6", "poses: 5 of 6"]
    assert said[1].endswith("about 42 s left")


def test_work_under_way_is_named_before_its_first_item_is_done() -> None:
    said, named = list[str](), Event()

    def say(line: str) -> None:
        said.append(line)
        named.set()

    def soon(items: Iterable[T], label: str, total: int) -> Iterator[T]:
        return report_progress(items, label, total, say=say, first_s=0.01)

    headed = Headed("city", soon)
    assert with_progress(lambda: named.wait(HANGS_S), "learning the words", headed)
    assert said == ["city: learning the words ..."]


def draw() -> bytes:
    figure = new_canvas(6, 4)
    with default_style():
        axes = figure.add_subplot()
        axes.plot([0, 1], [1, 2], label="a")
        axes.legend()
    return figure_bytes(figure, "png")


SCRIPT = f"""
import sys
import airzoo_bench.cli.main
heavy = {{"open3d", "faiss", "pycolmap", "scipy", "shapely", "rasterio", "PIL"}}
more = {{"pandas", "pyproj", "pyarrow", "matplotlib"}}
assert not (heavy | more) & set(sys.modules), (heavy | more) & set(sys.modules)
import airzoo_bench.retrieval.track
assert not heavy & set(sys.modules), heavy & set(sys.modules)
from {__name__} import draw
sys.stdout.buffer.write(draw())
"""


def test_commands_start_light_and_pictures_are_alike_whatever_rules_matplotlib(tmp_path) -> None:
    """Ranked ids need no heavy imports; neither a folder nor a program changes a picture."""
    plain = draw()
    assert plain.startswith(b"\x89PNG")
    with matplotlib.rc_context({"font.size": 30, "figure.facecolor": "red"}):
        assert draw() == plain
        assert matplotlib.rcParams["font.size"] == 30
    rules = "text.usetex: True\nfont.size: 30\nfigure.facecolor: red\nsavefig.bbox: tight\n"
    (tmp_path / "matplotlibrc").write_text(rules)
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        cwd=tmp_path,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == plain
