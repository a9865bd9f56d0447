"""A real LaTeX for tests: from a document to what its page shows."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.support import HANGS_S

MINUS = "\u2212"

# On one large page. Here is no bibliography: keys are printed instead of numbers, and an underscore
# is a rule, which the font lacks.
_HEAD = r"""\documentclass{article}
\usepackage[utf8]{inputenc}
\usepackage[paperwidth=150cm,paperheight=80cm,margin=1cm]{geometry}
\usepackage{graphicx}
\usepackage{booktabs}
\usepackage[table]{xcolor}
\pagestyle{empty}
\setlength{\parindent}{0pt}
{\catcode`\_=12
\gdef\keyparts#1_#2\keyend{#1\ifx\relax#2\relax\else\_\keyparts#2\keyend\fi}
\gdef\cite#1{[\expandafter\keyparts\detokenize{#1}_\keyend]}}
\begin{document}
"""


def document(table: str) -> str:
    """Return a document that shows what a table is in LaTeX."""
    return f"{_HEAD}{table}\n\\end{{document}}\n"


def typeset(document: str, folder: Path) -> str:
    """Compile a document and return its text, a line of the table a line; skip without LaTeX."""
    for program in ("pdflatex", "pdftotext"):
        if shutil.which(program) is None:
            pytest.skip(f"no {program}: apt install texlive-latex-recommended poppler-utils")
    (folder / "table.tex").write_text(document, encoding="utf-8")
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "table.tex"]
    done = subprocess.run(command, cwd=folder, capture_output=True, timeout=HANGS_S)
    log = done.stdout.decode("utf-8", "replace")
    if done.returncode and ".sty' not found" in log.replace("\n", ""):
        pytest.skip("a package is missing: apt install texlive-latex-recommended")
    assert done.returncode == 0, log[-2000:]
    for warning in ("Overfull", "Missing character"):
        assert warning not in log, log[-2000:]
    assert "(1 page," in log
    command = ["pdftotext", "-layout", "table.pdf", "-"]
    done = subprocess.run(command, cwd=folder, capture_output=True, check=True)
    return done.stdout.decode()
