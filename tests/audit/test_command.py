"""The command: exit codes, formats, options, and the paper's own tables."""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from airzoo_bench.tables.render import FORMATS
from tests.audit.support import COUNTS, SCENES, csv_text, row, rows_of
from tests.support import PUBLISHED, run_main

Command = Callable[..., Result]

ROOT = Path(__file__).parents[2]


@pytest.fixture
def clean(tmp_path: Path) -> Path:
    path = tmp_path / "clean.csv"
    path.write_text(csv_text(row(R_1="96.21", R_3="96.59", R_5="100.00")))
    return path


@pytest.fixture
def wrong(tmp_path: Path) -> Path:
    path = tmp_path / "wrong.csv"
    path.write_text(csv_text(row(R_1="96.22", R_3="95.83")))
    return path


@pytest.fixture
def paper() -> Path:
    return PUBLISHED


@pytest.mark.parametrize("form", FORMATS)
def test_exit_codes(command: Command, clean: Path, wrong: Path, form: str) -> None:
    assert command("audit", clean, "--format", form).exit_code == 0
    found = command("audit", wrong, "--counts", "East=264", "--format", form)
    assert found.exit_code == 1
    assert "impossible" in found.stdout


def test_rounding_alone_is_no_fault(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    rows = rows_of({"X": {"East": {"R@1": "10.00"}}})
    rows += rows_of({"X (Ours)": {"East": {"R@1": "12.00"}}}, gain="+2.01")
    path.write_text(csv_text(rows))
    run = command("audit", path)
    assert run.exit_code == 0
    assert "0 impossible, 0 inconsistent, 1 rounding" in run.stdout


def test_json(command: Command, wrong: Path) -> None:
    content = json.loads(command("audit", wrong, "-f", "json").stdout)
    names = [column["title"] for column in content["columns"]]
    (finding,) = (dict(zip(names, values, strict=True)) for values in content["rows"])
    assert (finding["Grade"], finding["Score"], finding["Printed"]) == (
        "impossible",
        "R@1",
        "96.22",
    )


@pytest.mark.parametrize("text", ["East", "East=", "=3", "East=0", "East=-4", "East=4,East=5", ""])
def test_bad_counts(wrong: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main("audit", wrong, "--counts", text) == 2
    assert "--counts" in capsys.readouterr().err


def test_a_mistyped_scene(wrong: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main("audit", wrong, "--counts", "Est=264") == 2
    assert "no scene 'Est' (did you mean 'East'?)" in capsys.readouterr().err


def test_bad_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1,2\n")
    assert run_main("audit", tmp_path / "a.csv") == 2
    assert "no column 'method'" in capsys.readouterr().err
    assert run_main("audit", tmp_path / "b.csv") == 2


def test_names_cannot_steer_the_terminal(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("method,scene,metric,value\n\x1b[31mA,E,R@1,101\n")
    run = command("audit", path)
    assert "\x1b" not in run.stdout
    assert "A" in run.stdout


def findings(command: Command, *arguments: object) -> list[dict[str, str]]:
    run = command("audit", *arguments, "--format", "csv")
    assert run.exit_code == 1, run.output
    return list(csv.DictReader(io.StringIO(run.stdout)))


def test_the_papers_counts_are_concluded(command: Command, paper: Path) -> None:
    notes = json.loads(command("audit", paper, "-f", "json").stdout)["notes"]
    for number, n in enumerate(SCENES, 1):
        assert any(f"Scene {number}: n = {n} fits" in note for note in notes)
    for place, n in [("retrieval, City", 161), ("matching, City", 161), ("matching, Rural", 190)]:
        assert any(f"AirZoo-Real, {place}: n = {n} fits" in note for note in notes)
    assert any("AerialExtreMatch, matching, overall: n = 264 fits" in note for note in notes)
    # An average over scenes is no share of queries.
    assert not any(
        "Average: n" in note or "UAV-VisLoc, retrieval, overall: n" in note for note in notes
    )
    told = [note for note in notes if "the definition is mean precision" in note]
    assert ["54 of 55" in told[0], "10 of 10" in told[1], len(told)] == [True, True, 2]


def test_the_papers_impossible_cells(command: Command, paper: Path) -> None:
    rows = findings(command, paper, "--counts", COUNTS, "--ap", "precision")
    cells = {
        (r["Scene"].split(", ")[1], r["Method"], r["Score"], r["Printed"])
        for r in rows
        if r["Grade"] == "impossible"
    }
    assert cells == {
        ("Scene 10", "SALAD", "AP@5", "14.41"),
        ("Scene 9", "MegaLoc (Ours)", "R@1", "15.90"),
        ("City", "RoMA (GIM)", "recall@10m", "81.44"),
    }
    near = {r["Printed"] for r in rows if (r["Grade"], r["Check"]) == ("rounding", "counts")}
    assert near == {"8.08", "73.30", "3.78"}


def test_the_papers_findings_by_check(command: Command, paper: Path) -> None:
    rows = findings(command, paper, "--counts", COUNTS, "--ap", "precision")
    assert Counter((r["Grade"], r["Check"]) for r in rows) == {
        ("impossible", "counts"): 2,
        ("rounding", "counts"): 3,
        ("impossible", "AP counts"): 1,
        ("inconsistent", "average"): 13,
        ("inconsistent", "row"): 1,
        ("inconsistent", "bold"): 6,
        ("inconsistent", "gain"): 2,
        ("rounding", "average"): 14,
        ("rounding", "gain"): 4,
    }
    # Without anything given, the numbers alone lead to the same cells.
    alone = findings(command, paper)
    assert {(r["Check"], r["Table"], r["Method"], r["Score"], r["Scene"]) for r in alone} == {
        (r["Check"], r["Table"], r["Method"], r["Score"], r["Scene"]) for r in rows
    }
    assert not any(r["Grade"] == "impossible" for r in alone)


def test_the_papers_wrong_gains(command: Command, paper: Path) -> None:
    wrong = [
        r["Why"]
        for r in findings(command, paper)
        if (r["Grade"], r["Check"]) == ("inconsistent", "gain")
    ]
    assert wrong == [
        "52.61 - 43.38 (VGGT) = +9.23, but the printed gain is +8.23",
        "91.42 - 87.38 (DA3-Large) = +4.04, but the printed gain is +2.93",
    ]


def test_the_page_on_the_paper_is_what_the_command_says(command: Command, paper: Path) -> None:
    page = (ROOT / "docs" / "audit-airzoo.md").read_text(encoding="utf-8")
    assert f'--counts "{COUNTS}" --ap precision' in " ".join(page.replace("\\\n", "").split())
    run = command("audit", paper, "--counts", COUNTS, "--ap", "precision", "-f", "markdown")
    table, *notes = run.stdout.strip().split("\n\n")
    assert f"## Findings\n\n{table}\n\n## What was checked\n" in page
    said = [note.removeprefix("checked, ").removeprefix("concluded, ") for note in notes]
    listed = page[page.index("## What was checked") :].splitlines()
    assert [f"- {note}" for note in said] == [line for line in listed if line.startswith("- ")]


@pytest.mark.parametrize("options", [[], ["--counts", COUNTS, "--ap", "precision"]])
def test_the_five_points_that_the_numbers_prove(
    command: Command, paper: Path, options: list[str]
) -> None:
    said = command("audit", paper, *options, "-f", "csv")
    rows = list(csv.DictReader(io.StringIO(said.stdout)))
    notes = said.stderr
    # 1. AP@5 is mean precision: of 65 cells one does not fit.
    assert notes.count("the definition is mean precision") == 2
    assert "54 of 55 values in scenes are whole numbers" in notes
    assert "10 of 10 values in scenes are whole numbers" in notes
    (odd,) = (row for row in rows if row["Check"] == "AP counts")
    assert [odd[key] for key in ("Scene", "Method", "Printed")] == [
        "UAV-VisLoc, Scene 10",
        "SALAD",
        "14.41",
    ]
    # 2. The numbers of queries, and a handful of cells that are no count of them.
    for number, n in enumerate(SCENES, 1):
        assert f"UAV-VisLoc, retrieval, Scene {number}: n = {n} fits" in notes
    for place, n in [("City", 161), ("Rural", 190)]:
        for track in ("retrieval", "matching"):
            assert f"AirZoo-Real, {track}, {place}: n = {n} fits" in notes
    assert "AerialExtreMatch, matching, overall: n = 264 fits" in notes
    counts = {row["Printed"] for row in rows if row["Check"] == "counts"}
    assert counts == {"15.90", "3.78", "8.08", "73.30", "81.44"}
    # 4. An average is the unweighted mean over scenes, of medians too, and no mean over queries.
    assert "MegaLoc (Ours), over scenes and over all queries: R@1 28.64 and 28.31" in notes
    assert "25 are unweighted means over scenes (of 7 medians 7), 3 more" in notes
    # 5. The main table against the one by scene, and gains against the values beside them.
    wrong = {(row["Check"], row["Table"]) for row in rows if row["Grade"] == "inconsistent"}
    assert {("average", "tab:uav-visloc"), ("gain", "tab:uav-recon")} <= wrong


def test_the_third_point_photos_that_are_no_queries(command: Command, paper: Path) -> None:
    photos = "Scene 6=344,Scene 7=30,Scene 9=734"
    run = command("audit", paper, "--counts", photos, "--ap", "precision", "-f", "json")
    notes = "\n".join(json.loads(run.stdout)["notes"])
    assert "Scene 6: n = 338 fits 20 of 20" in notes
    for n, given, left in [(338, 344, 6), (26, 30, 4), (444, 734, 290)]:
        found = re.search(
            rf"n = {n} fits .*; the n given is {given}, which fits [01]\b: were {left} queries",
            notes,
        )
        assert found, (n, notes)


@pytest.mark.parametrize("width", [40, 80, 300])
def test_the_terminal_s_width(
    command: Command, paper: Path, width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    lines = command("audit", paper).stdout.splitlines()
    assert max(map(len, lines)) <= min(width, 100)
    assert lines[0].startswith("airzoo-paper.csv") or lines[0].startswith("tables.csv")
    assert sum("[average]" in line for line in lines) >= 20 or width == 40


def test_nothing_found_says_what_was_checked(command: Command, clean: Path) -> None:
    text = command("audit", clean).stdout
    assert "Nothing found." in text
    assert "order      3 pairs" in text
    assert "bold       not checked: the file does not say what is bold" in text
    assert "--counts" in text


def test_the_example_of_the_page(command: Command, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "audit.md").read_text(encoding="utf-8")
    blocks = [block.split("\n", 1)[1] for block in page.split("```")[1::2]]
    shown = next(block for block in blocks if block.startswith("$ airzoo-bench audit "))
    table = next(block for block in blocks if block.startswith("method,scene,"))
    (tmp_path / "table.csv").write_text(table, encoding="utf-8")
    run = command("audit", tmp_path / "table.csv", "--counts", "City=161,Rural=190")
    assert shown.split("\n", 1)[1] == run.stdout
