"""``airzoo-bench table`` by its options, and the layouts behind it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.results.result import Reference, write_result
from airzoo_bench.tables.layouts import (
    benchmarks_layout,
    methods_layout,
    scenes_layout,
    scenes_table,
)
from airzoo_bench.tables.marks import mark_best
from airzoo_bench.tables.method_table import method_table, with_floors
from tests.results.made import result
from tests.support import run_main, write_predictions
from tests.tables.two_results import CITY, RURAL, Show, made
from tests.tables.typeset import document, typeset

LATEX = ("--format", "latex")


def test_one_result_by_scene() -> None:
    table = scenes_table(result(), methods=method_table([result()], every_score=True))
    assert table.texts() == [
        ["Scene", "3", "30.00", "inf"],
        ["Average", "–", "30.00", "inf"],
        ["Pooled", "3", "30.00", "inf"],
    ]
    assert [column.heading for column in table.columns][2:] == ["R@1 [%] ↑", "Distance [m] ↓"]
    assert len(scenes_table(result()).columns) == 3
    assert "A note." in table.notes


def test_several_results_side_by_side() -> None:
    one, other = result("one", **{"recall@1": 0.5}), result("other", **{"recall@1": 0.6})
    for scene in (None, "s", "Scene"):
        table = mark_best(methods_layout(method_table([one, other]), scene))
        assert table.texts() == [["one", "50.00"], ["other", "60.00"]]
        assert [row.cells[1].best for row in table.rows] == [False, True]
    with pytest.raises(ResultError, match="no scene 'x' in the results"):
        methods_layout(method_table([one, other]), "x")


def test_benchmarks_go_by_their_titles() -> None:
    board = method_table([result("m")])
    boards = [
        replace(board, benchmark=name, title=f"{name} v1") for name in ("airzoo-mini", "lake")
    ]
    titles = [column.group for column in benchmarks_layout(boards).columns]
    assert titles == ["", "AirZoo-Mini", "lake"]
    variants = [boards[0], replace(boards[0], title="other v1")]
    titles = [column.group for column in benchmarks_layout(variants).columns]
    assert titles == ["", "airzoo-mini v1", "other v1"]


def test_floors_are_set_apart_and_never_the_best() -> None:
    parts = {"City": {"recall@1": 0.75}, "Rural": {"recall@1": 0.5}}
    mean = {"recall@1": 0.625}
    chance = Reference(meaning="of all orders.", scenes=parts, overall=mean, pooled=mean)
    results = [
        made(name, {"City": {"recall@1": city}, "Rural": RURAL}, references={"Chance": chance})
        for name, city in {"Mine": 0.5, "Poor": 0.25}.items()
    ]
    table = mark_best(scenes_layout(with_floors(method_table(results), results)), second=True)
    *own, floor = table.rows
    assert floor.floor
    assert floor.is_apart(own[-1])
    assert not any(cell.best or cell.second for cell in floor.cells)
    best = [[cell.best for cell in row.cells[1:]] for row in own]
    assert best == [[True, True, True], [False, True, False]]
    alone = scenes_table(results[0], floors=True).rows
    assert [(row.name, row.cells[2].value) for row in alone if row.floor] == [("Chance", 62.5)]
    assert not any(row.floor for row in scenes_table(results[0]).rows)


def test_scenes_and_published_numbers(
    files: list[Path], show: Show, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = show(*files, "--layout", "scenes")
    assert list(rows[0]) == ["Method", "City R@1", "Rural R@1", "Average R@1"]
    assert list(rows[1].values()) == ["MegaLoc", "60.00", "25.00", "42.50"]
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
    for one, said in (
        (
            made("Mine", {"City": CITY, "Rural": RURAL}, shipped=False),
            "is not the shipped protocol",
        ),
        (result(), "nothing is published on b (retrieval)"),
    ):
        write_result(path, one)
        assert run_main("table", path, "--published") == 0
        assert said in capsys.readouterr().out


def test_gains(files: list[Path], show: Show) -> None:
    rows = show(*files, "--baseline", "MegaLoc")
    assert [row["R@1 gain"] for row in rows] == ["7.50", ""]
    rows = show(*files, "--published", "--baseline", "SALAD", "--highlight", "Mine")
    assert [row["R@1 gain"] for row in rows] == [""] * 5 + ["42.64", ""]
    # Of two rows of one name, the one that was scored here.
    rows = show(*files, "--published", "--baseline", "MegaLoc (Ours)=MegaLoc")
    assert [row["R@1 gain"] for row in rows][4] == "-23.84"


def test_methods_of_one_name_share_a_row(tmp_path: Path, show: Show) -> None:
    paths = []
    for name, benchmark in (("Ours", "a"), ("Ours", "b"), ("Other", "b")):
        one = made(name, {"City": {"recall@1": 0.5}, "Rural": {"recall@1": 0.25}})
        truth = one.truth.model_copy(update={"benchmark": benchmark})
        protocol = one.protocol.model_copy(update={"name": f"{benchmark}-protocol"})
        changes = {"truth": truth, "protocol": protocol}
        paths.append(tmp_path / f"{name} {benchmark}.json")
        write_result(paths[-1], one.model_copy(update=changes).with_checksum())
    rows = show(*paths, "--baseline", "Other")
    assert [list(row.values())[:4] for row in rows] == [
        ["Ours", "37.50", "37.50", "0.00"],
        ["Other", "–", "37.50", ""],
    ]


def test_a_document_with_everything(
    files: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--layout", "scenes", "--published", "--second", "--baseline", "MegaLoc"]
    options += ["--highlight", "Mine", "--cite", "airzoo-paper", "--cite", "Mine=me:2026,you"]
    assert run_main("table", *files, *options, *LATEX) == 0
    text = typeset(document(capsys.readouterr().out), tmp_path)
    rows = [" ".join(line.split()) for line in text.splitlines()]
    # The second best is underlined, and the best of those that were scored here is bold.
    assert "Mine [me:2026,you] 50.00 (−10.00) 50.00 (+25.00) 50.00 (+7.50)" in rows
    assert any(row.startswith("SALAD [izquierdo2024optimal]†") for row in rows), text
    assert "reported, not re-scored" in text


@pytest.mark.parametrize(
    ("options", "fragments"),
    [
        (["--layout", "result"], ["layout result"]),
        (["--layout", "scenes", "--scene", "City"], ["layout scenes", "--scene"]),
        (["--baseline", "Megaloc"], ["--baseline", "'Megaloc' (did you mean 'MegaLoc'?)"]),
        (["--highlight", "x"], ["--highlight", "'x'", "Mine, MegaLoc"]),
        (["--cite", "x", *LATEX], ["--cite 'x' is no citation", "METHOD=KEY", "airzoo-paper"]),
        (["--cite", "Nobody=a", *LATEX], ["--cite", "'Nobody'"]),
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

    def table(*options: str) -> str:
        capsys.readouterr()
        assert run_main("table", tmp_path / "out", "--intervals", *options) == 0
        return capsys.readouterr().out

    shown = json.loads(table("--layout", "scenes", "--format", "json"))
    place = [column.get("group") for column in shown["columns"]].index("Scene east")
    low, high = (shown["uncertainties"][0][place][key] for key in ("low", "high"))
    assert 0 < low < shown["rows"][0][place] < high < 100
    assert any(note.startswith("in square brackets: 95 % intervals") for note in shown["notes"])
    # Of one result, a row a scene.
    own = json.loads(table("--format", "json"))
    assert own["columns"][0]["title"] == "Scene"
    rows = {row[0]: spans for row, spans in zip(own["rows"], own["uncertainties"], strict=True)}
    assert rows["Scene east"][2] == shown["uncertainties"][0][place]
    assert rows["Pooled"] == [None] * len(own["columns"])
    [legend] = [line for line in table(*LATEX).splitlines() if "footnotesize" in line]
    assert "in square brackets: 95 \\% intervals" in legend.replace(r"\\ ", "")
