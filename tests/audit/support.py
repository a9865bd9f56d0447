"""Published tables made on the spot."""

from __future__ import annotations

import csv
import io
from fractions import Fraction
from pathlib import Path

from airzoo_bench.audit.audit import audit
from airzoo_bench.audit.findings import Audit, Finding
from airzoo_bench.audit.values import decimal_text
from airzoo_bench.tables.published import Published, read_published

Rows = list[dict[str, object]]


def rows_of(values: dict[str, dict[str, dict[str, str]]], **extra: object) -> Rows:
    """Return rows from method -> scene -> score -> value."""
    return [
        {"method": method, "scene": scene, "metric": score, "value": value} | extra
        for method, scenes in values.items()
        for scene, scores in scenes.items()
        for score, value in scores.items()
    ]


def row(**scores: str) -> Rows:
    """Return one method's row on one scene; `R_1` stands for R@1."""
    named = {name.replace("_", "@"): value for name, value in scores.items()}
    return rows_of({"A": {"East": named}})


def rows_of_wide(text: str) -> Rows:
    """Return rows from lines a method, such as `A,East,**50.0**` below `method,scene,R@1 [%]`."""
    rows: Rows = []
    for line in csv.DictReader(io.StringIO(text)):
        beside = {name: line[name] for name in ("table", "n") if name in line}
        names = {"method": line["method"], "scene": line.get("scene", "overall")}
        for head, value in line.items():
            if head in names or head in beside:
                continue
            metric, _, unit = head.rstrip("]").partition(" [")
            number = value.strip("*")
            bold = {"bold": int(number != value)} if "**" in text else {}
            rows.append(
                {**beside, **names, "metric": metric, "unit": unit, "value": number, **bold}
            )
    return rows


def csv_text(rows: Rows) -> str:
    out = io.StringIO()
    columns = list(dict.fromkeys(name for row in rows for name in row))
    writer = csv.DictWriter(out, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def published(folder: Path, rows: Rows) -> Published:
    path = folder / "table.csv"
    path.write_text(csv_text(rows), encoding="utf-8")
    return read_published(path)


def audited(folder: Path, rows: Rows, **counts: int) -> Audit:
    return audit(published(folder, rows), counts)


def told(found: Audit, check: str | None = None) -> list[tuple[str, str, str, str]]:
    """Return grade, check, method and score of the findings."""
    return [
        (f.grade.value, f.check, f.cell.method, f.cell.metric)
        for f in found.findings
        if check in (None, f.check)
    ]


def only(found: Audit, check: str) -> Finding:
    (finding,) = (f for f in found.findings if f.check == check)
    return finding


def percent(count: int, total: int, decimals: int = 2) -> str:
    return decimal_text(Fraction(100 * count, total), decimals)


SCENES = (817, 1071, 768, 738, 473, 338, 26, 1033, 444, 144, 590)
COUNTS = ",".join(
    [
        *(f"Scene {i}={n}" for i, n in enumerate(SCENES, 1)),
        "City=161,Rural=190,AerialExtreMatch/overall=264",
    ]
)
