"""Tables of papers and pages, typed as their authors type them: read, or left out with a reason."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.audit.audit import audit
from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.printed.cells import Published
from airzoo_bench.tables.printed.table import read_published

PAPERS = Path(__file__).parent / "papers"


def read(name: str) -> Published:
    return read_published(PAPERS / name)


def of(published: Published, table: str) -> dict[tuple[str, str, str], str]:
    return {
        (cell.method, cell.scene, cell.score.name): cell.number.text
        for cell in published.cells
        if cell.table == table
    }


@pytest.mark.parametrize("name", sorted(path.name for path in PAPERS.iterdir()))
def test_nothing_is_found_where_nothing_is_wrong(name: str) -> None:
    assert audit(read(name)).findings == ()


def test_a_page_of_place_recognition() -> None:
    page = read("place_recognition.md")
    models = of(page, "Trained models")
    assert models["ResNet50, 512", "MSLS-val", "R@5"] == "92.2"
    assert models["DINOv2-B", "Nordland", "R@1"] == "83.0"
    assert of(page, "Comparison")["TileVPR", "overall", "Tokyo 24/7"] == "95.9"
    notes = "\n".join(page.notes)
    assert "left out: Installation, line 7: no column of methods and no known score" in notes
    assert "left out: Comparison (2), line 33: " in notes
    assert "Trained models: rows of one name are told apart by Output dim." in notes


def test_a_paper_of_reconstruction_with_its_own_macros() -> None:
    paper = read("any_view.tex")
    pose = of(paper, "tab:pose")
    assert pose["ViewFold-L", "HiRoom", "AUC@3"] == "80.3"
    assert pose["ViewFold", "HiRoom", "AUC@3"] == "47.0"
    assert ("CUT3R", "DTU-64", "AUC@3") not in pose
    gains = {c.scene: c.gain.text for c in paper.cells if c.gain and c.score.name == "AUC@3"}
    assert gains == {"HiRoom": "+31.2", "ETH3D": "+22.1", "DTU-64": "+14.9"}
    assert of(paper, "tab:cloud")["Ours", "2024", "Acc"] == "0.079"
    assert of(paper, "tab:long")["w/o rays", "overall", "F1"] == "0.611"
    muted = {cell.method for cell in paper.cells if not cell.competes}
    assert muted == {"oracle poses"}
    notes = "\n".join(paper.notes)
    for said in (
        "files that it inputs are not read: tables/ablation",
        "left out: tab:data, line 65: no column of methods and no known score",
        "tab:pose: differences between rows, left out: line 38",
        "tab:pose: fields without a number, left out: 'OOM' in line 35 and 1 more",
        "tab:pose: read without what follows the number: '47.0",
        "tab:long: shares that are all at most 1 are read as such",
    ):
        assert said in notes
    assert "Z" not in {cell.method for cell in paper.cells}


def test_a_paper_of_drones_and_satellites() -> None:
    paper = read("university.tex")
    table = of(paper, "tab:uni")
    assert table["Ours, ConvNeXt-B", "Drone→Satellite", "R@1"] == "94.80"
    assert table["Ours, ConvNeXt-T", "Satellite→Drone", "AP"] == "91.02"
    assert of(paper, "tab:sues")["Ours", "Drone→Satellite 300m", "AP"] == "98.41"


@pytest.mark.parametrize(
    ("name", "old", "new", "found"),
    [
        ("any_view.tex", "\\gain{14.9}", "\\gain{15.9}", ("gain", "ViewFold-L", "AUC@3")),
        ("any_view.tex", "26.3", "56.3", ("bold", "ViewFold-L", "AUC@3")),
        ("any_view.tex", "& 58.5 &", "& 58.5 &", None),
        ("university.tex", "\\bf 98.00", "\\bf 91.00", ("bold", "Ours", "R@1")),
        ("place_recognition.md", "**83.0** | **91.7**", "83.0 | **82.0**", ("order", None, "R@1")),
    ],
)
def test_what_is_wrong_in_one_is_found(
    name: str, old: str, new: str, found: tuple[str, str | None, str] | None, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_text((PAPERS / name).read_text(encoding="utf-8").replace(old, new, 1))
    told = [
        (f.check, f.cell.method, f.cell.score.name) for f in audit(read_published(path)).findings
    ]
    if found is None:
        assert told == []
        return
    check, method, score = found
    assert any((c, s) == (check, score) and method in (None, m) for c, m, s in told)


YEARS = r"""
\begin{tabular}{lcccc}
 & \multicolumn{2}{c}{2023} & \multicolumn{2}{c}{2024} \\
Method & R@1 & R@5 & R@1 & R@5 \\
X & 10.0 & 20.0 & 30.0 & 40.0 \\
\end{tabular}
"""


def test_heads_that_are_years(tmp_path: Path) -> None:
    path = tmp_path / "t.tex"
    path.write_text(YEARS)
    heads = [(cell.scene, cell.score.name) for cell in read_published(path).cells]
    assert heads == [("2023", "R@1"), ("2023", "R@5"), ("2024", "R@1"), ("2024", "R@5")]


YEARS_OVER_ROWS = r"""
\begin{tabular}{lcc}
 & \multicolumn{2}{c}{City} \\
Method & R@1 & R@5 \\
\midrule
\multicolumn{3}{c}{2023} \\
A & 10.00 & 20.00 \\
\textbf{2024} & & \\
B & 12.00 & 22.00 \\
C & \textbf{11.00} & 21.00 \\
\end{tabular}
"""


def test_years_over_groups_of_rows(tmp_path: Path) -> None:
    path = tmp_path / "t.tex"
    path.write_text(YEARS_OVER_ROWS)
    found = read_published(path)
    assert found.notes == ()
    shown = [(cell.method, cell.scene, cell.score.name) for cell in found.cells]
    assert shown == [(name, "City", score) for name in "ABC" for score in ("R@1", "R@5")]
    sections = {cell.method: cell.section for cell in found.cells}
    assert sections["A"] != sections["B"] == sections["C"]


def test_tables_of_other_scenes_are_not_averaged_together(tmp_path: Path) -> None:
    one = (
        "| Method | City R@1 | Rural R@1 | Average R@1 |\n|-|-|-|-|\n| X | 10.00 | 20.00 | 15.00 |"
    )
    other = one.replace("City", "East").replace("Rural", "West").replace("15.00", "35.00")
    other = other.replace("10.00", "30.00").replace("20.00", "40.00")
    path = tmp_path / "t.md"
    path.write_text(f"# A\n\n{one}\n\n# B\n\n{other}\n")
    found = audit(read_published(path))
    assert found.findings == ()
    averages = next(outcome for outcome in found.outcomes if outcome.check == "average")
    assert averages.tested == 2


@pytest.mark.parametrize(
    ("head", "row", "expected"),
    [
        ("Method & Metric & R@1", "X & \\checkmark & 5.0", ("X", "overall", "R@1")),
        ("Method & Metric & City", "X & R@1 & 5.0", ("X", "City", "R@1")),
        ("Metric & X & Y", "R@1 & 5.0 & 6.0", ("X", "overall", "R@1")),
        ("Method & (5m, 1$^\\circ$)", "X & 5.0", ("X", "overall", "(5m, 1°)")),
        ("Method & 0.25m, 2\\degree", "X & 5.0", ("X", "overall", "0.25m, 2°")),
    ],
)
def test_heads(tmp_path: Path, head: str, row: str, expected: tuple[str, str, str]) -> None:
    path = tmp_path / "t.tex"
    path.write_text(f"{head} \\\\\n{row} \\\\\n")
    cell = read_published(path).cells[0]
    assert (cell.method, cell.scene, cell.score.name) == expected
    assert cell.score.is_share


def test_a_paper_without_scores_is_refused(tmp_path: Path) -> None:
    table = "\\begin{tabular}{lc} Dataset & Images \\\\ One & 5 \\\\ \\end{tabular}\n"
    path = tmp_path / "t.tex"
    path.write_text(table * 2)
    with pytest.raises(
        ResultError, match="none of 2 tables can be read: left out: table in line 1"
    ):
        read_published(path)


SHOWN = """
| Method | City R@1 | City R@5 | Rural R@1 | Rural R@5 | Average R@1 | Average R@5 |
|-|-|-|-|-|-|-|
| X | 10.00 | 20.00 | 12.00 | 22.00 | 31.00 | 43.10 |
| Y | 11.00 | 21.00 | 13.00 | {} | 32.00 | 44.20 |
"""


@pytest.mark.parametrize("field", ["23.00", "2 / 23"])
def test_averages_over_more_scenes_than_are_shown(tmp_path: Path, field: str) -> None:
    path = tmp_path / "t.md"
    path.write_text(f"# A\n{SHOWN.format(field)}\n# B\n\n| Method | R@1 |\n|-|-|\n| X | 5.00 |\n")
    found = audit(read_published(path))
    assert found.findings == ()
    averages = next(outcome for outcome in found.outcomes if outcome.check == "average")
    assert averages.tested == 0


def test_a_year_behind_a_name_is_no_number_of_queries(tmp_path: Path) -> None:
    path = tmp_path / "t.tex"
    path.write_text(YEARS.replace("{2023}", "{KITTI (2012)}").replace("{2024}", "{City (161)}"))
    cells = read_published(path).cells
    assert [(cell.scene, cell.queries) for cell in cells[1:3]] == [
        ("KITTI (2012)", None),
        ("City", 161),
    ]


def test_a_typed_file_of_tables_of_other_scenes(tmp_path: Path) -> None:
    rows = [
        *(f"T1,X,{scene},{value}" for scene, value in (("A", "10.00"), ("B", "20.00"))),
        *(f"T2,X,{scene},{value}" for scene, value in (("C", "30.00"), ("D", "40.00"))),
        "T1,X,Average,15.00",
        "T2,X,Average,35.00",
    ]
    path = tmp_path / "t.csv"
    path.write_text("table,method,scene,R@1\n" + "\n".join(rows) + "\n")
    found = audit(read_published(path))
    assert found.findings == ()
    said = [c.text for c in found.conclusions if c.check == "average"]
    assert said == ["of 1 average, 1 is an unweighted mean over scenes"] * 2
