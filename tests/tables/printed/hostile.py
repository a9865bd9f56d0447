"""Files made to take long or much: nearly as large as is read, by what they are made of."""

from __future__ import annotations

from collections.abc import Callable

SIZE = 1_900_000


def many(piece: str, before: str = "", after: str = "") -> str:
    return before + piece * ((SIZE - len(before) - len(after)) // len(piece)) + after


def tabular(body: str) -> str:
    return "\\begin{tabular}{lc}\n" + body + "\\end{tabular}\n"


def tables(number: int, rows: int) -> str:
    """Return tables of the same methods and scores, so that each is held against each."""
    made = []
    for table in range(number):
        lines = (f"M{i} & {table}{i % 10}.{i % 7}1 & {i % 97}.2 \\\\\n" for i in range(rows))
        body = tabular("Method & R@1 & R@5 \\\\\n" + "".join(lines))
        made.append(f"\\begin{{table}}\\label{{t{table}}}\n{body}\\end{{table}}\n")
    return "".join(made)


BOMB = "".join(
    "\\newcommand{\\" + one + "}{" + f"\\{other}" * 40 + "}\n"
    for one, other in zip("abcdefgh", "bcdefghi", strict=True)
)
NESTED = "\\newcommand{\\best}[1]{\\textbf{#1}}\n"
HEAD = "Method & R@1 \\\\\n"

FILES: dict[str, Callable[[], str]] = {
    "macros that never close.tex": lambda: NESTED + tabular(HEAD + "X & " + many("\\best{")),
    "macros that make macros.tex": lambda: BOMB + tabular(HEAD + "X & \\a \\\\\n"),
    "a macro of itself.tex": lambda: many(
        "\\x", "\\def\\x{\\x\\x}\\begin{tabular}{l} M & R@1\\\\ "
    ),
    "definitions.tex": lambda: many("\\newcommand ", "", tabular(HEAD)),
    "blanks in a definition.tex": lambda: many(" ", "\\newcommand", tabular(HEAD)),
    "blanks behind one.tex": lambda: many(" ", "\\newcommand\\x", tabular(HEAD)),
    "tables.tex": lambda: many("\\begin{tabular}{l}x\\end{tabular}"),
    "tables that never open.tex": lambda: many("\\begin{tabular}{l \\end{tabular}"),
    "tables in a field.tex": lambda: tabular(HEAD + many("\\begin{tabular}{ \\end{tabular}")),
    "open floats.tex": lambda: many("\\begin{table}\\label{x}", "", tabular(HEAD)),
    "closed floats.tex": lambda: many("\\end{table}", tabular(HEAD)),
    "nested spans.tex": lambda: tabular(HEAD + many("\\multicolumn{1}{c}{", "X & ")),
    "wide heads.tex": lambda: tabular(many("\\multicolumn{150}{c}{x}\\\\\n", HEAD)),
    "wide rows.tex": lambda: tabular(many("X & \\multicolumn{99}{c}{5}\\\\\n", HEAD)),
    "fields.tex": lambda: tabular(HEAD + many("&")),
    "rows.tex": lambda: tabular(many("X & 5.0 \\\\\n", HEAD)),
    "rules.tex": lambda: tabular(many("\\midrule ", HEAD)),
    "rows of blanks.tex": lambda: tabular(many("\n", HEAD, "X & 5 \\\\\n")),
    "one long field.tex": lambda: tabular(HEAD + "X & " + many("{1") + "\\\\\n"),
    "ties.tex": lambda: tabular(HEAD + "X & " + many("~") + "\\\\\n"),
    "digits.tex": lambda: tabular(HEAD + "X & " + many("1") + "a \\\\\n"),
    "an interval.tex": lambda: tabular(HEAD + "X & 5 [" + many("1,") + "\\\\\n"),
    "a head of words.tex": lambda: "Method & " + many("a ") + "\\\\\nX & 5.0 \\\\\n",
    "tables alike.tex": lambda: tables(190, 120),
    "comments.tex": lambda: many("\\", "", tabular(HEAD)),
    "dead code.tex": lambda: many("\\iffalse ", tabular(HEAD)),
    "blanks.md": lambda: "| Method | R@1 |\n" + many(" ") + "|x-\n",
    "links.md": lambda: "| Method | R@1 |\n|-|-|\n| X | " + many("[a](") + "|\n",
    "headings.md": lambda: many("# ", "", "\n| Method | R@1 |\n|-|-|\n| X | 5 |\n"),
    "tables.md": lambda: many("| Method | R@1 |\n|-|-|\n| X | 5 |\n\n"),
    "fields.md": lambda: "| Method | R@1 |\n|-|-|\n" + many("|"),
    "numbers.csv": lambda: many(",1", "method" + ",R@1" * 400 + "\n"),
    "numbers by line.csv": lambda: many("A,1,2,3,4,5,6,7,8,9\n", "method,a,b,c,d,e,f,g,h,i\n"),
    "columns.csv": lambda: many(",x", "method") + "\n",
}
