"""Tables as people have them: wide ones, other separators, marks in the fields, LaTeX, Markdown."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from airzoo_bench.audit.audit import audit
from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.printed.annotations import Marked, plain_name, read_marked
from airzoo_bench.tables.printed.cells import PrintedValue
from airzoo_bench.tables.printed.scores import Family
from airzoo_bench.tables.printed.table import read_published


def read(folder: Path, text: str) -> tuple[PrintedValue, ...]:
    path = folder / "table.csv"
    path.write_bytes(text.encode())
    return read_published(path).cells


def values(cells: tuple[PrintedValue, ...]) -> list[tuple[str, str, str, str]]:
    return [(c.method, c.scene, c.score.name, c.number.text) for c in cells]


FIELDS = {
    "96.21": ("96.21", None, False, False),
    "96.21%": ("96.21", None, False, True),
    r"96.21\%": ("96.21", None, False, True),
    "96,21 %": ("96.21", None, False, True),
    "0,962": ("0.962", None, False, False),
    "1234,5": ("1234.5", None, False, False),
    "**96.21**": ("96.21", None, True, False),
    "<b>96.21</b>": ("96.21", None, True, False),
    r"\textbf{96.21}": ("96.21", None, True, False),
    r"{\bf 96.21}": ("96.21", None, True, False),
    r"$\mathbf{96.21}$": ("96.21", None, True, False),
    r"\underline{96.21}": ("96.21", None, False, False),
    "96.21 (+1.73)": ("96.21", "+1.73", False, False),
    "96.21 (↑1.73)": ("96.21", "+1.73", False, False),
    "3.03 (−0.19)": ("3.03", "-0.19", False, False),
    r"\textbf{96.21} \textcolor{gray}{(+1.73)}": ("96.21", "+1.73", True, False),
    r"96.21 {\scriptsize (+1.73)}": ("96.21", "+1.73", False, False),
    r"\best{96.21}": ("96.21", None, False, False),
    r"\best{\textbf{96.21\%}}": ("96.21", None, True, True),
    "96.21 [94.10, 97.30]": ("96.21", None, False, False),
    r"96.21 {[}94.10, 97.30] {\color{gray}(+1.73)}": ("96.21", "+1.73", False, False),
    r"{\phantom{00}\llap{\textbf{91}}\rlap{\textbf{.53}}\phantom{.53}}": (
        "91.53",
        None,
        True,
        False,
    ),
    r"$96.21_{+1.73}$": ("96.21", "+1.73", False, False),
    r"96.21 \textbf{(+1.73)}": ("96.21", "+1.73", False, False),
    "−2.65": ("-2.65", None, False, False),
}


@pytest.mark.parametrize("text", FIELDS)
def test_a_field(text: str) -> None:
    marked = read_marked(text)
    assert isinstance(marked, Marked), marked
    gain = marked.gain.text if marked.gain else None
    assert (marked.number.text, gain, marked.bold, marked.percent) == FIELDS[text]


@pytest.mark.parametrize(
    "text",
    ["", "x", "1,234", "1,234.5", "1.2.3", "96.21 (1.73)", "96.21 ± 1", "96.21 / 3", "5†", "%"],
)
def test_what_is_no_field(text: str) -> None:
    assert isinstance(read_marked(text), str)


def test_names_without_marks() -> None:
    assert plain_name(r"\textbf{RoMA}~\cite{edstedt2024roma} (Ours)") == "RoMA (Ours)"
    assert plain_name(r"A\&B\_1") == "A&B_1"


WIDE = (
    "Method,Scene,R@1,R@5 [%],Med. [m],n\nX,City,8.70,**24.84**,3.2,161\nX,Rural,4.21,-,2.5,190\n"
)


def test_a_wide_table(tmp_path: Path) -> None:
    cells = read(tmp_path, WIDE)
    assert values(cells) == [
        ("X", "City", "R@1", "8.70"),
        ("X", "City", "R@5", "24.84"),
        ("X", "City", "Med.", "3.2"),
        ("X", "Rural", "R@1", "4.21"),
        ("X", "Rural", "Med.", "2.5"),
    ]
    assert [cell.line for cell in cells] == [2, 2, 2, 3, 3]
    assert [cell.bold for cell in cells] == [False, True, False, False, False]
    assert [cell.unit for cell in cells][:3] == ["", "%", "m"]
    assert {cell.queries for cell in cells} == {161, 190}


def test_wide_is_audited_as_long(tmp_path: Path) -> None:
    cells = "A,City,96.23 (+2.00)\nB,City,94.23\n"
    (tmp_path / "t.csv").write_text("method,scene,R@1\n" + cells)
    found = audit(read_published(tmp_path / "t.csv"), {"City": 264})
    assert [(f.grade.value, f.check, f.cell.method) for f in found.findings] == [
        ("impossible", "counts", "A"),
        ("impossible", "counts", "B"),
    ]


def test_a_wide_table_without_scenes(tmp_path: Path) -> None:
    assert values(read(tmp_path, "method,R@1\nX,5.0\n")) == [("X", "overall", "R@1", "5.0")]


def test_columns_of_gains(tmp_path: Path) -> None:
    (cell,) = read(tmp_path, "method,R@1,R@1 gain,Marked\nX,5.0,+1.0,yes\n")
    assert cell.gain is not None
    assert cell.gain.text == "+1.0"


SAME = [("X", "City", "R@1", "8.70"), ("Y, Z", "City", "R@1", "9.94")]

LAYOUTS = {
    "semicolons and commas": "method;scene;R@1\nX;City;8,70\nY, Z;City;9,94 %\n",
    "semicolons, long": "method;scene;metric;value\nX;City;R@1;8,70\nY, Z;City;R@1;9,94\n",
    "tabs": "method\tscene\tR@1\r\nX\tCity\t8.70\r\nY, Z\tCity\t9.94\r\n",
    "byte order mark": '\ufeffmethod,scene,R@1\nX,City,8.70\n"Y, Z",City,9.94\n',
    "quoted": '"Method","Scene","R@1"\n"X","City","8,70"\n\n"Y, Z","City","9.94%"\n',
    "Markdown": "| Method | Scene | R@1 ↑ |\n| --- | :-: | --: |\n| X | City | 8.70 |\n"
    "| **Y, Z** | City | **9.94** |\n",
    "Markdown with notes": "| Method | Scene | R@1 \\[%\\] |\n| - | - | - |\n| X | City | 8.70 |\n"
    "| Y, Z | City | 9.94 |\n\nof one protocol, by somebody\n",
    "LaTeX": r"""
\begin{tabular}{llc}
\toprule
Method & Scene & R@1 $\uparrow$ \\ % the head
\midrule
X~\cite{x} & City & 8.70 \\
\textbf{Y, Z} & City &
  \textbf{9.94} \textcolor{gray}{(+1.24)} \\
\bottomrule
\end{tabular}
""",
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts(name: str, tmp_path: Path) -> None:
    assert values(read(tmp_path, LAYOUTS[name])) == SAME


BAD = {
    "no score": ("method,scene,colour\nX,City,red\n", ["no column is a score", "colour"]),
    "a score's field": ("method,scene,R@1\nX,City,8.7O\n", ["line 2, column 'R@1'", "'O'"]),
    "mistyped": ("method,scen,R@1\nX,City,8.70\n", ["unknown column 'scen'", "'scene'"]),
    "bold column": ("method,R@1,bold\nX,8.70,1\n", ["column 'bold'", "**96.21** (+1.73)"]),
    "n": ("method,scene,R@1,n\nX,City,8.70,many\n", ["line 2, column 'n'", "'many'"]),
    "method": ("methode,scene,R@1\nX,City,8.70\n", ["unknown column 'methode'", "'method'"]),
    "unit": ("method,scene,R@1 [m]\nX,City,8.70\n", ["column 'R@1 [m]'", "% or share"]),
    "short line": ("method,scene,R@1\nX,City\n", ["line 2", "fields (2) as the first (3)"]),
    "spans": (
        "Method & R@1 & R@5 \\\\\nX & \\multicolumn{2}{c}{5.0} \\\\\nY & 5.0 & 6.0 \\\\\n",
        ["line 2", "'5.0' spans columns that hold different things"],
    ),
    "Markdown's short line": (
        "| Method | R@1 | R@5 |\n| - | - | - |\n| X | 5.0 |\n",
        ["line 3", "fields (2) as the first (3)", "\\|"],
    ),
    "LaTeX's short line": (
        "Method & R@1 & R@5 \\\\\nX & 5.0 \\\\\n",
        ["line 2", "fields (2) as the first (3)", "\\&"],
    ),
    "a macro": (
        "Method & R@1 \\\\\nX & 5.0\\pm 0.1 \\\\\n",
        ["line 2", "what is '± 0.1'"],
    ),
    "text after rows": ("method & R@1 \\\\\nX & 5.0 \\\\\nfoot", ["line 3", "'foot' is no row"]),
    "method only": ("method,scene\nX,City\n", ["no column 'metric', 'value'"]),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_refused(name: str, tmp_path: Path) -> None:
    text, fragments = BAD[name]
    with pytest.raises(ResultError) as raised:
        read(tmp_path, text)
    for fragment in fragments:
        assert fragment in str(raised.value)


def test_accuracy_in_percent_is_no_distance(tmp_path: Path) -> None:
    (cell,) = read(tmp_path, "method,Accuracy\nX,87.5%\n")
    assert cell.score.higher_is_better is True
    (alone,) = read(tmp_path, "method,Accuracy\nX,87.5\n")
    assert alone.score.higher_is_better is None
    cloud = read(tmp_path, "method,Accuracy,Completeness\nX,0.5,0.7\n")
    assert [cell.score.higher_is_better for cell in cloud] == [False, False]


WHOLE = r"""
% a whole float, as it stands in a paper
\begin{table*}[t]
\caption{Results on {\bf two} scenes, R@1 & R@5. \\ Best in bold.}
\centering
\resizebox{\linewidth}{!}{
\begin{tabular}{@{}l|S[table-format=2.2]c|p{2cm}c@{}} % four columns
\toprule[1pt]
\multirow{2}{*}{Method} & \multicolumn{2}{c|}{City} & \multicolumn{2}{c}{\textbf{Rural} [\%]} \\
\cmidrule(lr){2-3}\cmidrule(l{2pt}r){4-5}
 & R@1$\uparrow$ & R@5 & R@1 & R@5 \\ \midrule
\multicolumn{5}{l}{\textit{Zero-shot}} \\
X~\cite{x} & 8.70 & 24.84 & \underline{4.21} & 11.05 \\[2pt]
\rowcolor[gray]{.9} Y (Ours) & \best{9.94}
  & \textbf{31.06} & 27.37 & -- \\
\bottomrule
\end{tabular}}
\label{tab:x}
\end{table*}
"""


def test_a_whole_latex_table(tmp_path: Path) -> None:
    cells = read(tmp_path, WHOLE)
    assert values(cells) == [
        ("X", "City", "R@1", "8.70"),
        ("X", "City", "R@5", "24.84"),
        ("X", "Rural", "R@1", "4.21"),
        ("X", "Rural", "R@5", "11.05"),
        ("Y (Ours)", "City", "R@1", "9.94"),
        ("Y (Ours)", "City", "R@5", "31.06"),
        ("Y (Ours)", "Rural", "R@1", "27.37"),
    ]
    assert [cell.line for cell in cells] == [13, 13, 13, 13, 14, 14, 14]
    assert [cell.bold for cell in cells] == [False] * 5 + [True, False]


def test_two_latex_tables_are_told_apart_by_their_labels(tmp_path: Path) -> None:
    cells = read(tmp_path, WHOLE + WHOLE.replace("tab:x", "tab:y"))
    assert [cell.table for cell in cells] == ["tab:x"] * 7 + ["tab:y"] * 7


@pytest.mark.parametrize("blank", ["", r"\rowcolor{gray}"])
def test_an_empty_name_is_the_one_above(tmp_path: Path, blank: str) -> None:
    table = f"Method & Scene & R@1 \\\\\nX & City & 8.70 \\\\\n{blank} & Rural & 4.21 \\\\\n"
    (tmp_path / "t.tex").write_text(table)
    published = read_published(tmp_path / "t.tex")
    assert [(c.method, c.scene) for c in published.cells] == [("X", "City"), ("X", "Rural")]
    assert published.notes == ("an empty name is read as the one above it: line 3",)


def test_a_caption_above_markdown(tmp_path: Path) -> None:
    text = "Table 1: results\n\n" + LAYOUTS["Markdown"] + "\nfoot | note\n"
    assert values(read(tmp_path, text)) == SAME
    bare = "Method | Scene | R@1\n--- | --- | ---\nX | City | 8.70\nY, Z | City | 9.94\n"
    assert values(read(tmp_path, bare)) == SAME


HEADS = {
    "Method,City R@1,City Median [m],Average R@1,Average Median [m]": [
        ("City", "R@1"),
        ("City", "Median"),
        ("Average", "R@1"),
        ("Average", "Median"),
    ],
    "Method,Scene 1 R@1,Scene 1 recall@(5m, 1deg)": [
        ("Scene 1", "R@1"),
        ("Scene 1", "recall@(5m, 1deg)"),
    ],
    "Method,Translation error,Rotation error": [
        ("overall", "Translation error"),
        ("overall", "Rotation error"),
    ],
    "Method,City Median,Rural Median,Average Median": [
        ("City", "Median"),
        ("Rural", "Median"),
        ("Average", "Median"),
    ],
}


@pytest.mark.parametrize("heads", HEADS)
def test_scenes_in_the_heads(tmp_path: Path, heads: str) -> None:
    names = next(csv.reader([heads.replace("(5m, 1deg)", "(5m; 1deg)")]))
    text = ";".join(name.replace(";", ",") for name in names) + "\nX" + ";5.00" * (len(names) - 1)
    assert [(c.scene, c.score.name) for c in read(tmp_path, text + "\n")] == HEADS[heads]


def test_a_table_of_one_method_need_not_name_it(tmp_path: Path) -> None:
    cells = read(tmp_path, "Scene,Queries,R@1,Chamfer\nCity,59,8.47,inf\nPooled,59,8.47,2.0\n")
    assert [(c.method, c.scene, c.queries) for c in cells[:1]] == [("(unnamed)", "City", 59)]
    assert [c.number.text for c in cells] == ["8.47", "8.47", "2.0"]
    assert [c.is_pooled for c in cells] == [False, True, True]


@pytest.mark.parametrize(
    ("heads", "families"),
    [
        ("P@10m [%],R@10m [%],F1@10m [%]", [Family.PRECISION, Family.RECALL, Family.F1]),
        ("Precision@10,Recall@10,F1@10", [Family.PRECISION, Family.RECALL, Family.F1]),
        ("Precision@10,Recall@10,F1@5", [Family.AVERAGE_PRECISION, Family.HITS, Family.F1]),
        ("AP@10,R@10m,F1@5m", [Family.AVERAGE_PRECISION, Family.HITS, Family.F1]),
        ("P@5m,R@5m,R@1", [Family.PRECISION, Family.RECALL, Family.HITS]),
    ],
)
def test_f1_beside_them_makes_recall_and_precision_those_of_clouds(
    tmp_path: Path, heads: str, families: list[Family]
) -> None:
    cells = read(tmp_path, f"method,scene,{heads}\nA,s1,70.10,40.20,51.10\n")
    assert [cell.score.family for cell in cells] == families
