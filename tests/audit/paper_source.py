"""The AirZoo paper's tables as LaTeX, made of its published numbers in the manner of a paper."""

from __future__ import annotations

import csv

from tests.support import PUBLISHED

Rows = list[dict[str, str]]

# What stands in the heads instead of the names of the data file.
HEADS = {
    "median_translation_error": r"\textbf{Med.}\dn",
    "recall@5m": r"\textbf{@5m}\up",
    "recall@10m": r"\textbf{@10m}\up",
    "recall@20m": r"\textbf{@20m}\up",
    "recall@(5m,1deg)": r"(5m, 1$^\circ$)\up",
    "recall@(10m,1deg)": r"(10\,m, 1\degree)\up",
    "recall@(20m,2deg)": r"(20m, 2°)\up",
}
# Its main table calls them otherwise.
MAIN_HEADS = HEADS | {
    "median_translation_error": r"median $\downarrow$",
    **{f"recall@{d}m": rf"acc@{d}m\up" for d in (5, 10, 20)},
}

BEFORE = r"""
\documentclass{article} % \begin{tabular}{lc} Method & R@1 \\ X & 101 \\ \end{tabular}
\newcommand{\up}{~$\uparrow$}
\newcommand\dn{~$\downarrow$}
\newcommand{\best}[1]{\textbf{#1}}
\newcommand{\gain}[2][gray]{{\color{#1}(#2)}}
\def\ours{MegaLoc (Ours)\xspace}
\begin{document}
\input{sections/intro}
\begin{table}
\caption{Data sets.}\label{tab:data}
\begin{tabular}{lccc}
\textbf{Dataset} & \textbf{Images} & \textbf{Regions} & \textbf{Depth} \\ \midrule
One & 37.8k & 1652 & \textcolor{gray}{\ding{55}} \\
\textbf{Two} & \textbf{1.2M} & \textbf{95} & \textbf{\ding{51}} \\
\end{tabular}
\end{table}
"""


def paper_latex() -> str:
    """Return the source of a paper with all tables of the data file."""
    tables: dict[str, Rows] = {}
    with PUBLISHED.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            tables.setdefault(row["table"], []).append(row)
    return (
        BEFORE + "".join(_float(label, rows) for label, rows in tables.items()) + r"\end{document}"
    )


def _float(label: str, rows: Rows) -> str:
    main = "overall" in {row["scene"] for row in rows}
    heads = MAIN_HEADS if main else HEADS
    places = list(dict.fromkeys((row["benchmark"], row["scene"]) for row in rows))
    size = len(places) if main else 2
    blocks = [_block(rows, places[i : i + size], heads) for i in range(0, len(places), size)]
    width = 1 + max(block.split("\\\\")[1].count("&") for block in blocks)
    return (
        "\\begin{table*}[t]\n\\caption{Results, R@1 \\& more.}\n\\resizebox{\\linewidth}{!}{%\n"
        f"\\begin{{tabular}}{{l*{{{width}}}{{c}}}}\n\\toprule\n"
        + "\\midrule\n".join(blocks)
        + f"\\bottomrule\n\\end{{tabular}}}}\n\\label{{{label}}}\n\\end{{table*}}\n"
    )


def _block(rows: Rows, places: list[tuple[str, str]], heads: dict[str, str]) -> str:
    """Return rows under the heads of one, two or more places side by side."""
    own = [row for row in rows if (row["benchmark"], row["scene"]) in places]
    scores = list(dict.fromkeys(row["metric"] for row in own))
    names = [benchmark if scene == "overall" else scene for benchmark, scene in places]
    lines = []
    if len(places) > 1 or places[0][1] != "overall":
        above = (rf"\multicolumn{{{len(scores)}}}{{c}}{{\textbf{{{name}}}}}" for name in names)
        lines.append(" & ".join(["", *above]) + " \\\\ \\cmidrule(lr){2-3}")
    titles = [heads.get(score, rf"\textbf{{{score}}}") for score in scores]
    lines.append(" & ".join([r"\textbf{Method}", *titles * len(places)]) + r" \\")
    for method in dict.fromkeys(row["method"] for row in own):
        fields = [_field(own, place, method, score) for place in places for score in scores]
        name = r"\rowcolor{yellow!25} \ours" if method == "MegaLoc (Ours)" else method
        name = name.replace(" (Ours)", "(Ours)") if method.startswith("VGGT") else name
        lines.append(" & \n".join([f"{name}~\\cite{{x}}", *fields]) + " \\\\")
    return "\n".join(lines) + "\n"


def _field(rows: Rows, place: tuple[str, str], method: str, score: str) -> str:
    wanted = (*place, method, score)
    row = next(r for r in rows if (r["benchmark"], r["scene"], r["method"], r["metric"]) == wanted)
    text = rf"\best{{{row['value']}}}" if row["bold"] == "1" else row["value"]
    sign = row["printed_delta"].replace("-", "--")
    return f"{text} \\gain{{\\textbf{{{sign}}}}}" if sign else text
