"""Published tables made on the spot."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from airzoo_bench.audit.audit import Audit, audit
from airzoo_bench.tables.published import PrintedValue, read_published

Rows = list[dict[str, object]]


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


def published(folder: Path, rows: Rows) -> list[PrintedValue]:
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
