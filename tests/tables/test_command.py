"""``airzoo-bench table`` by its options: layouts, published rows, marks, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.results.result import write_result
from tests.results.made import result
from tests.support import run_main, write_predictions
from tests.tables.two_results import CITY, RURAL, Show, made
from tests.tables.typeset import document, typeset

LATEX = ("--format", "latex")


def test_scenes_side_by_side(files: list[Path], show: Show) -> None:
    rows = show(*files, "--layout", "scenes")
    assert list(rows[0]) == ["Method", "City R@1", "Rural R@1", "Average R@1"]
    assert list(rows[1].values()) == ["MegaLoc", "60.00", "25.00", "42.50"]


def test_published_numbers_alone(show: Show, capsys: pytest.CaptureFixture[str]) -> None:
    rows = show("airzoo-real-retrieval", "--published", "--layout", "scenes")
    assert list(rows[0])[:3] == ["Method", "City R@1", "City R@3"]
    assert [row["City R@1"] for row in rows] == ["0.62", "6.83", "21.12", "8.70", "9.94"]
    several = show("airzoo-real-retrieval", "uav-visloc-retrieval", "--published")
    assert {name.rpartition(" ")[0] for name in several[0]} >= {"AirZoo-Real", "UAV-VisLoc"}
    assert run_main("table", "airzoo-demo-retrieval", "--published") == 2
    assert "nothing is published on airzoo-demo-retrieval" in capsys.readouterr().err


def test_another_protocol_and_another_benchmark(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "result.json"
    scenes = {"City": CITY, "Rural": RURAL}
    write_result(path, made("Mine", scenes, shipped=False))
    assert run_main("table", path, "--published") == 0
    assert "is not the shipped protocol: reported numbers may measure" in capsys.readouterr().out
    write_result(path, result())
    assert run_main("table", path, "--published") == 0
    assert "nothing is published on b (retrieval)" in capsys.readouterr().out


def test_gains(files: list[Path], show: Show) -> None:
    rows = show(*files, "--baseline", "MegaLoc")
    assert [row["R@1 gain"] for row in rows] == ["7.50", ""]
    rows = show(*files, "--published", "--baseline", "SALAD", "--highlight", "Mine")
    assert [row["R@1 gain"] for row in rows] == [""] * 5 + ["42.64", ""]
    # Of two rows of one name, the one that was scored here.
    rows = show(*files, "--published", "--baseline", "MegaLoc (Ours)=MegaLoc")
    assert [row["R@1 gain"] for row in rows][4] == "-23.84"


def test_a_document_with_everything(
    files: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--layout", "scenes", "--published", "--second", "--baseline", "MegaLoc"]
    options += ["--highlight", "Mine", "--cite", "airzoo-paper", "--cite", "Mine=me:2026,you"]
    options += ["--format", "latex"]
    assert run_main("table", *files, *options) == 0
    text = typeset(document(capsys.readouterr().out), tmp_path)
    rows = [line.split() for line in text.splitlines()]
    # The second best is underlined, and the best of those that were scored here is bold.
    assert ["Mine", "[me:2026,you]", "50.00", "(−10.00)", "50.00", "(+25.00)"] in rows
    assert any(row[:2] == ["SALAD", "[izquierdo2024optimal]†"] for row in rows), text
    assert "reported, not re-scored" in text


@pytest.mark.parametrize(
    ("options", "fragments"),
    [
        (["--layout", "result"], ["layout result", "2 results"]),
        (["--layout", "scenes", "--scene", "City"], ["--scene does not go with layout scenes"]),
        (["--cite", "a=b"], ["--cite", "--format latex"]),
        (["--baseline", "Megaloc"], ["no row is called 'Megaloc' (did you mean 'MegaLoc'?)"]),
        (["--baseline", "Mine=Megaloc"], ["no row is called 'Mine=Megaloc'"]),
        (
            ["--baseline", "MegaLoc=Mine", "--baseline", "MegaLoc=MegaLoc"],
            ["--baseline MegaLoc=MegaLoc: MegaLoc has two baselines"],
        ),
        (["--highlight", "x"], ["--highlight: no row is called 'x'", "Mine, MegaLoc"]),
        (["--cite", "x", *LATEX], ["--cite 'x' is no citation", "METHOD=KEY", "airzoo-paper"]),
        (["--cite", "Mine=a}b", *LATEX], ["'a}b' is no citation key"]),
        (["--cite", "Nobody=a", *LATEX], ["--cite: no row is called 'Nobody'"]),
        (["--cite", "none.toml", *LATEX], ["none.toml: no such file of citations"]),
        (["--score", "R@2"], ["called 'R@2' (did you mean 'R@1'", "one of: R@1; Distance"]),
        (["--scene", "Sea"], ["no scene 'Sea'", "one of City, Rural"]),
        (["--intervals"], ["records"]),
    ],
)  # fmt: skip
def test_what_is_refused(
    options: list[str], fragments: list[str], files: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("table", *files, *options) == 2
    out, message = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in message
    for fragment in fragments:
        assert fragment in message


def test_intervals(
    data: Path, tmp_path: Path, perfect: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    perfect["ranked_ids"][0] = list(reversed(perfect["ranked_ids"][0]))
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    assert run_main("eval", "retrieval", path, "--out", tmp_path / "out") == 0
    capsys.readouterr()
    options = ["--intervals", "--layout", "scenes", "--format", "json"]
    assert run_main("table", tmp_path / "out" / "result.json", *options) == 0
    shown = json.loads(capsys.readouterr().out)
    place = [column.get("group") for column in shown["columns"]].index("Scene east")
    low, high = (shown["uncertainties"][0][place][key] for key in ("low", "high"))
    assert 0 < low < shown["rows"][0][place] < high < 100
    assert any(note.startswith("in square brackets: 95 % intervals") for note in shown["notes"])
    # Of one result, a row a scene.
    assert run_main("table", tmp_path / "out", "--intervals", "--format", "json") == 0
    own = json.loads(capsys.readouterr().out)
    assert own["columns"][0]["title"] == "Scene"
    rows = {row[0]: spans for row, spans in zip(own["rows"], own["uncertainties"], strict=True)}
    assert rows["Scene east"][2] == shown["uncertainties"][0][place]
    assert rows["Pooled"] == [None] * len(own["columns"])
    assert run_main("table", tmp_path / "out", "--intervals", *LATEX) == 0
    lines = capsys.readouterr().out.splitlines()
    (legend,) = [line for line in lines if "footnotesize" in line]
    assert "in square brackets: 95 \\% intervals, Wilson over" in legend.replace(r"\\ ", "")
