"""What is found in the CSV of the paper's numbers is found in LaTeX, one by one, and no more."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from tests.audit.paper_source import paper_latex
from tests.audit.support import COUNTS
from tests.support import PAPER, PUBLISHED

Command = Callable[..., Result]

# The real paper lies beside some checkouts only; what is made of its numbers is in its manner.
SOURCES = ("made", *(["real"] if (PAPER / "airzoo.tex").is_file() else []))
OF_THE_FILE = {"AerialExtreMatch/": "tab:6dof_recall/"}

SCORES = {
    "Med.": "median_translation_error",
    "median": "median_translation_error",
    **{f"{stem}@{d}m": f"recall@{d}m" for d in (5, 10, 20) for stem in ("", "acc")},
    **{
        f"({d}m, {a}{sign}": f"recall@({d}m,{a}deg)"
        for d, a in ((5, 1), (10, 1), (20, 2))
        for sign in ("°)", "deg)")
    },
    "(10 m, 1°)": "recall@(10m,1deg)",
}


@pytest.fixture(params=SOURCES)
def paper(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "real":
        return PAPER / "airzoo.tex"
    path = tmp_path / "paper.tex"
    path.write_text(paper_latex(), encoding="utf-8")
    return path


def found(command: Command, *arguments: object) -> list[tuple[str, ...]]:
    """Return the findings with the names of scores, scenes and methods as the CSV has them."""
    run = command("audit", *arguments, "--format", "csv")
    assert run.exit_code == 1, run.output
    rows = csv.DictReader(io.StringIO(run.stdout))
    return sorted(map(normal, rows))


def normal(row: dict[str, str]) -> tuple[str, ...]:
    *benchmark, scene = row["Scene"].split(", ")
    if row["Table"] == "tab:uav-recon":
        scene = benchmark[0] if benchmark else scene
    score = SCORES.get(row["Score"], row["Score"])
    names = (row["Grade"], row["Check"], row["Table"], scene, row["Method"].replace(" ", ""))
    why = row["Why"].replace(" (Ours)", "(Ours)")
    return *names, score, row["Printed"], why


@pytest.mark.parametrize("given", [False, True], ids=["alone", "with counts"])
def test_the_same_is_found_one_by_one(command: Command, paper: Path, given: bool) -> None:
    options = ["--ap", "precision", "--counts"] if given else []
    in_table = found(command, PUBLISHED, *options, *([COUNTS] if given else []))
    counts = COUNTS.replace(*next(iter(OF_THE_FILE.items())))
    in_latex = found(command, paper, *options, *([counts] if given else []))
    assert len(in_table) == 46
    if not given and "(161)" in paper.read_text(encoding="utf-8"):
        # The heads of the real paper give the number of queries: what they contradict cannot be.
        in_table = sorted(map(as_given, in_table))
    assert in_latex == in_table


def as_given(finding: tuple[str, ...]) -> tuple[str, ...]:
    grade, check, table, *others, why = finding
    if (check, table) != ("counts", "tab:matching_results"):
        return finding
    known = why.replace(" (n = 161 is what the other values of the scene imply)", "")
    return "rounding" if grade == "rounding" else "impossible", check, table, *others, known


def test_what_is_taken_together_and_what_is_left_out(command: Command, paper: Path) -> None:
    notes = json.loads(command("audit", paper, "-f", "json").stdout)["notes"]
    together = [note for note in notes if note.startswith("tables of one benchmark")]
    pairs = [sorted(note.partition("numbers: ")[2].split(", ")) for note in together]
    assert sorted(pairs) == [
        ["tab:matching_results", "tab:translation_accuracy"],
        ["tab:ourflight-retrieval", "tab:uav_real_scenes"],
        ["tab:uav-visloc", "tab:uav_visloc_scenes"],
    ]
    out = [note for note in notes if note.startswith("left out: ")]
    assert out
    assert all("no column of methods and no known score" in note for note in out)


def test_all_numbers_are_read_and_checked(command: Command, paper: Path) -> None:
    lines = command("audit", paper).stdout.splitlines()
    assert lines[0].endswith("in 473 values")
    assert sum(note in " ".join(lines) for note in ("108 averages", "258 shares")) == 2
