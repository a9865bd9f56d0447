"""Published tables made on the spot."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from airzoo_bench.audit.audit import audit
from airzoo_bench.audit.findings import Audit
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


SCENES = (817, 1071, 768, 738, 473, 338, 26, 1033, 444, 144, 590)
COUNTS = ",".join(
    [
        *(f"Scene {i}={n}" for i, n in enumerate(SCENES, 1)),
        "City=161,Rural=190,AerialExtreMatch/overall=264",
    ]
)
