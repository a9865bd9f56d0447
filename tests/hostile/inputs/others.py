"""Results, published tables, and the sources of own photos."""

from __future__ import annotations

from pathlib import Path

from tests.hostile.inputs.case import Input
from tests.hostile.mutations import spoil_bytes, spoil_text
from tests.support import make_place, run_main

__all__ = ["results", "sources", "tables"]


def results(home: Path, retrieval: Path) -> list[Input]:
    ranked = retrieval / "given" / "ranked.npz"
    for name, kind in (("mine", "csv"), ("theirs", "csv"), ("third", "parquet")):
        out = home / name
        data = ("--data", retrieval / "data", "--out", out, "--method", name, "--records", kind)
        assert run_main("eval", "retrieval", ranked, *data) == 0
    both = ("FOLDER/mine", "FOLDER/theirs")
    cheap = (
        ("compare", *both, "--resamples", "50"),
        *(("table", *both, "--format", form) for form in ("latex", "csv", "html", "terminal")),
        ("table", *both, "--intervals", "--resamples", "50"),
        ("breakdown", "FOLDER/mine", "--by", "weather"),
    )
    report = (("report", *both, "--out", "FOLDER/r.html"),)
    made = []
    for file, spoil in (("result.json", spoil_text), ("records.csv", spoil_text)):
        made.append(
            Input(f"results/{file}", home, f"mine/{file}", spoil, cheap, None, 0.7, checksums=True)
        )
        made.append(
            Input(f"report/{file}", home, f"mine/{file}", spoil, report, None, 0.2, checksums=True)
        )
    third = tuple(
        tuple(word.replace("mine", "third") for word in command) for command in (*cheap, *report)
    )
    file = "third/records.parquet"
    made.append(Input("results/parquet", home, file, spoil_bytes, third, None, 0.4, checksums=True))
    return made


_LONG = "method,scene,metric,value\n" + "".join(
    f"{m},{s},{k},{v}\n"
    for m, v in (("A", "50.31"), ("B", "61.49"))
    for s in ("City", "Rural")
    for k in ("R@1", "R@5")
)
_WIDE = """| Method | R@1 | R@5 | AP@5 |
|---|---|---|---|
| A | 50.31 | 61.49 | 40.0 |
| **B** | 1 | 2 | 3 |
"""
_LATEX = r"""\begin{tabular}{l|cc|cc}
\toprule
\multirow{2}{*}{Method} & \multicolumn{2}{c|}{City (161)} & \multicolumn{2}{c}{Rural (190)} \\
\cmidrule{2-3} & R@1 & R@5 & R@1 & R@5 \\ \midrule
A \cite{a} & 50.31 & \textbf{61.49} & 1.05 & 2.11 \\
B & \underline{51.55} & 60.87 & $2.63_{\pm 0.1}$ & -- \\ \bottomrule
\end{tabular}
"""


def tables(home: Path) -> list[Input]:
    home.mkdir()
    made = []
    for name, text in (("long.csv", _LONG), ("wide.md", _WIDE), ("paper.tex", _LATEX)):
        (home / name).write_text(text)
        made.append(Input(f"audit/{name}", home, name, spoil_text, (("audit", "FILE"),)))
    return made


def sources(home: Path) -> list[Input]:
    home.mkdir()
    make_place(home, {"a.jpg": (64.0, 64.0), "b.jpg": (192.0, 64.0)})
    options = {
        "--name": "park",
        "--images": "FOLDER/photos",
        "--poses": "FOLDER/poses.json",
        "--dom": "FOLDER/dom.tif",
        "--dsm": "FOLDER/dsm.tif",
        "--tile-size": "64",
        "--out": "FOLDER/out",
    }
    command = ("prepare", "photos", *(text for pair in options.items() for text in pair))
    return [
        Input("prepare/poses.json", home, "poses.json", spoil_text, (command,), None, 0.15),
        Input("prepare/photo", home, "photos/a.jpg", spoil_bytes, (command,), None, 0.1),
        Input("prepare/dom.tif", home, "dom.tif", spoil_bytes, (command,), None, 0.1),
        Input("prepare/dsm.tif", home, "dsm.tif", spoil_bytes, (command,), None, 0.1),
    ]
