"""Mutated tables: whatever a file holds, it is audited or refused, and ends soon."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from airzoo_bench.audit.audit import audit
from airzoo_bench.audit.findings import audit_table, audit_text
from airzoo_bench.core.errors import UserError
from airzoo_bench.tables.printed.table import read_published
from tests.audit.paper_source import paper_latex
from tests.support import PUBLISHED
from tests.tables.printed.typed import LAYOUTS, WHOLE, WIDE

PAPERS = Path(__file__).parents[1] / "tables" / "printed" / "papers"

# What readers of tables stumble over.
PIECES = (
    *("&", "\\\\", "\\", "{", "}", "[", "]", "%", "|", "|-|", ",", ";", "\t", '"', "\n", "\n\n"),
    *("\\multicolumn{2}{c}{", "\\multicolumn{0}{c}{x}", "\\multirow{2}{*}{2023}", "\\textbf{"),
    *("\\begin{tabular}{lc}", "\\end{tabular}", "\\begin{table}", "\\end{table}", "\\label{tab:x}"),
    *("\\newcommand{\\a}[1]{\\a{#1}\\a{#1}}", "\\a{5}", "\\def\\b#1#2{#2#1}", "\\b", "\\midrule"),
    *("Method & 2021 & 2022 \\\\", "& \\multicolumn{2}{c}{2023} & \\multicolumn{2}{c}{2024} \\\\"),
    *("R@1", "R@0", "AP@5", "AP@0", "AP@9999", "F1", "City R@1", "(5m, 1°)", "Average", "Metric"),
    *("method", "scene", "metric", "value", "table", "benchmark", "n", "bold", "gain", "City (0)"),
    *(
        "0",
        "-1",
        "1e9",
        "999999999",
        "0.000000001",
        "100",
        "101.5",
        "+1.0",
        "(+1)",
        "±",
        "inf",
        "-",
    ),
    *("\x00", "\x1d", "\ufeff", "²", "٣", "½", "\u2028", "é", "🛰", "<b>", "&amp;", "<br>", "# x"),
)


def seeds() -> list[tuple[str, str]]:
    files = [(path.suffix, path.read_text(encoding="utf-8")) for path in sorted(PAPERS.iterdir())]
    short = "\n".join(PUBLISHED.read_text(encoding="utf-8").splitlines()[:60]) + "\n"
    made = paper_latex()
    whole = [(".tex", WHOLE), (".csv", WIDE), (".csv", short), (".tex", made[:6000])]
    return [*files, *whole, *((".md" if "|" in t else ".csv", t) for t in LAYOUTS.values())]


SEEDS = seeds()


def mutated(text: str, source: random.Random, changes: int) -> str:
    for _ in range(changes):
        at = source.randrange(len(text) + 1)
        end = min(len(text), at + source.choice((0, 1, 1, 3, 20, 200)))
        other = source.randrange(len(text) + 1)
        piece = source.choice(PIECES)
        text = source.choice(
            (
                text[:at] + piece + text[at:],
                text[:at] + piece + text[end:],
                text[:at] + text[end:],
                text[:at] + text[at:end] * 2 + text[end:],
                text[:other] + text[at:end] + text[other:],
                text[:end] if end > len(text) // 2 else text[at:],
            )
        )
    return text


def check(folder: Path, number: int, seed: int) -> None:
    source = random.Random(seed)
    suffix, text = SEEDS[number % len(SEEDS)]
    path = folder / f"table{suffix}"
    path.write_text(mutated(text, source, source.randint(1, 6)), encoding="utf-8", newline="")
    try:
        found = audit(read_published(path))
    except UserError:
        return
    assert audit_text(found, 80)
    assert audit_table(found).columns


@settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.integers(0, len(SEEDS) - 1), st.integers(0, 2**32))
def test_mutated_tables_are_audited_or_refused(tmp_path: Path, number: int, seed: int) -> None:
    check(tmp_path, number, seed)


@pytest.mark.slow
def test_many_mutated_tables_are_audited_or_refused(tmp_path: Path) -> None:
    for seed in range(5_000):
        check(tmp_path, seed, seed)
