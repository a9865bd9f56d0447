"""Tables as people type them."""

from __future__ import annotations

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


WIDE = (
    "Method,Scene,R@1,R@5 [%],Med. [m],n\nX,City,8.70,**24.84**,3.2,161\nX,Rural,4.21,-,2.5,190\n"
)


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
