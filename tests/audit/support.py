"""Published tables made on the spot: of short lines, and as an honest paper prints them."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import ROUND_DOWN, ROUND_HALF_DOWN, ROUND_HALF_EVEN, ROUND_HALF_UP, Decimal
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from airzoo_bench.audit.audit import Audit, audit
from airzoo_bench.tables.published import PrintedValue, read_published

Rows = list[dict[str, object]]
AT = (1, 3, 5)
METHODS = ("Base", "Other", "Third", "Base (Ours)")
ROUNDINGS = (ROUND_HALF_UP, ROUND_HALF_EVEN, ROUND_HALF_DOWN, ROUND_DOWN)
GAINS = ("none", "exact", "printed", "best")
LOWER = ("median error",)
Exact = dict[str, dict[str, dict[str, Fraction]]]


def rows_of_wide(text: str) -> Rows:
    """Return rows of lines such as `method,scene,R@1; A,East,**50.0** (+1.0)`, bold and a gain."""
    rows: Rows = []
    lines = [line.strip() for line in text.split(";")]
    for line in csv.DictReader(lines):
        names = {name: line[name] for name in ("table", "method", "scene", "n") if name in line}
        for metric in [name for name in line if name not in names]:
            number, _, gain = line[metric].rstrip(")").partition(" (")
            beside = {"gain": gain} if "(" in text else {}
            beside |= {"bold": str(int("*" in number))} if "**" in text else {}
            rows.append({**names, "metric": metric, "value": number.strip("*"), **beside})
    return rows


def published(rows: Rows) -> list[PrintedValue]:
    """Write rows to a file, and read them as a user's."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with TemporaryDirectory() as folder:
        path = Path(folder, "table.csv")
        with path.open("w", encoding="utf-8", newline="") as out:
            writer = csv.DictWriter(out, columns, restval="")
            writer.writeheader()
            writer.writerows(rows)
        return read_published(path)


def audited(rows: Rows, counts: Mapping[str, int] | None = None) -> Audit:
    return audit(published(rows), counts)


def told(found: Audit) -> list[tuple[str, str, str, str]]:
    """Return grade, check, method and score of the findings."""
    return [(f.grade.value, f.check, f.cell.method, f.cell.metric) for f in found.findings]


# --- honest tables ---


@dataclass(frozen=True)
class Manner:
    """How a paper prints scenes of so many queries.

    Averages are over scenes, or `pooled`; `gains` are not printed, or of the last method over the
    first, before or after rounding, or over the best of the others. Of several that print the same
    best value all are bold, or only the best before rounding.
    """

    seed: int
    scenes: tuple[int, ...]
    rounding: str = ROUND_HALF_UP
    decimals: int = 2
    pooled: bool = False
    gains: str = "exact"
    all_bold: bool = True

    @property
    def counts(self) -> dict[str, int]:
        return {f"S{i}": n for i, n in enumerate(self.scenes)}


def draw_manner(seed: int) -> Manner:
    """Draw a manner to print in."""
    random = np.random.default_rng(seed)
    return Manner(
        seed,
        tuple(int(n) for n in np.exp(random.uniform(1.6, 7.3, random.integers(1, 7)))),
        ROUNDINGS[random.integers(len(ROUNDINGS))],
        int(random.integers(0, 5)),
        bool(random.integers(2)),
        GAINS[random.integers(len(GAINS))],
        bool(random.integers(2)),
    )


def honest(manner: Manner) -> Rows:
    """Return the rows of a true table."""
    random = np.random.default_rng(manner.seed)
    exact: Exact = {
        method: {scene: _scores(random, n) for scene, n in manner.counts.items()}
        for method in METHODS
    }
    weights = {s: n if manner.pooled else 1 for s, n in manner.counts.items()}
    total = sum(weights.values())
    for scenes in exact.values() if len(weights) > 1 else ():
        scenes["Average"] = {
            name: sum((scenes[s][name] * w for s, w in weights.items()), Fraction(0)) / total
            for name in scenes["S0"]
        }
    return [row for method in METHODS for row in _rows(exact, method, manner)]


def _scores(random: np.random.Generator, queries: int) -> dict[str, Fraction]:
    hits = random.random((queries, 5)) < random.uniform(0.02, 0.6)
    errors = np.round(random.exponential(random.uniform(1, 20), queries), 6)
    counts = {f"R@{k}": int(hits[:, :k].any(1).sum()) for k in AT}
    counts |= {f"recall@{d}m": int((errors < d).sum()) for d in (5, 10, 20)}
    scores = {name: Fraction(100 * n, queries) for name, n in counts.items()}
    scores["AP@5"] = Fraction(100 * int(hits.sum()), 5 * queries)
    scores["median error"] = Fraction(float(np.median(errors))).limit_denominator(10**7)
    return scores


def _rows(exact: Exact, method: str, manner: Manner) -> Rows:
    rows: Rows = []
    for scene, scores in exact[method].items():
        for name, value in scores.items():
            column = {m: exact[m][scene][name] for m in METHODS}
            row: dict[str, object] = {"method": method, "scene": scene, "metric": name}
            row["value"] = text(value, manner)
            row["unit"] = "m" if name in LOWER else "%"
            row["gain"] = _gain(column, name, manner) if method == METHODS[-1] else ""
            row["bold"] = int(method in _bold(column, name, manner))
            rows.append(row)
    return rows


def text(value: Fraction, manner: Manner) -> str:
    """Print an exact number; more digits than any test prints are none that could change it."""
    exact = Decimal(value.numerator) / Decimal(value.denominator)
    return f"{exact.quantize(Decimal(1).scaleb(-manner.decimals), manner.rounding):f}"


def _bold(column: dict[str, Fraction], name: str, manner: Manner) -> list[str]:
    pick = min if name in LOWER else max
    if manner.all_bold:
        shown = {m: Fraction(text(v, manner)) for m, v in column.items()}
        return [m for m, v in shown.items() if v == pick(shown.values())]
    return [next(m for m, v in column.items() if v == pick(column.values()))]


def _gain(column: dict[str, Fraction], name: str, manner: Manner) -> str:
    if manner.gains == "none":
        return ""
    own = column[METHODS[-1]]
    others = {m: v for m, v in column.items() if m != METHODS[-1]}
    pick = min if name in LOWER else max
    base = pick(others.values()) if manner.gains == "best" else others[METHODS[0]]
    if manner.gains == "exact":
        return text(own - base, manner)
    shown = Fraction(text(own, manner)) - Fraction(text(base, manner))
    return f"{float(shown):+.{manner.decimals}f}"
