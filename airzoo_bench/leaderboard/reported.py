"""Published methods as rows of a board, with the audit's findings on their numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from airzoo_bench.audit.audit import audit
from airzoo_bench.leaderboard.measured import OVERALL
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.method_table import MethodRow, MethodTable, with_published
from airzoo_bench.tables.published import (
    published_sources,
    published_tables,
    read_published,
    read_source_file,
)

__all__ = ["Findings", "read_findings", "reported_rows"]

Findings = Mapping[tuple[str, str, str], Sequence[dict[str, Any]]]
"""By benchmark, track and method; the scene is a title, or `OVERALL`."""


def read_findings() -> Findings:
    """Audit the sources that travel with the package."""
    found: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for path in published_sources().values():
        source = read_source_file(path)
        for one in audit(read_published(path.with_name(source.data))).findings:
            cell = one.cell
            key = (source.benchmarks.get(cell.benchmark, ""), cell.track, cell.method)
            found.setdefault(key, []).append(
                {
                    "scene": OVERALL if cell.is_summary else cell.scene,
                    "score": source.scores.get(cell.track, {}).get(cell.score.name, ""),
                    "grade": one.grade.value,
                    "check": one.check,
                    "printed": cell.number.text,
                    "why": one.why,
                    "source": ", ".join(filter(None, (source.name, cell.table))),
                }
            )
    return found


def reported_rows(
    benchmark: str,
    track: str,
    columns: Sequence[ScoreColumn],
    scenes: Mapping[str, str],
    findings: Findings,
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return a row for each published method of a benchmark and track, and notes on them."""
    tables = published_tables(benchmark, track)
    if not tables:
        return [], []
    empty = MethodTable("", benchmark, track, tuple(columns), scenes)
    scenic = any(table.has_scenes for table in tables)
    made = with_published(empty, tables, by_scene=scenic)
    rows = {row.method: row for row in made.rows}
    if scenic:
        for row in with_published(empty, tables, by_scene=False).rows:
            rows.setdefault(row.method, row)
    ids = {title: scene for scene, title in scenes.items()} | {OVERALL: OVERALL}
    return [
        {
            "kind": "reported",
            "method": row.method,
            "source": row.reported,
            "numbers": _numbers(columns, row),
            "findings": [
                finding | {"scene": ids[finding["scene"]]}
                for finding in findings.get((benchmark, track, row.method), ())
                if finding["scene"] in ids
            ],
        }
        for row in rows.values()
        if row.values
    ], list(made.notes)


def _numbers(columns: Sequence[ScoreColumn], row: MethodRow) -> dict[str, dict[str, Any]]:
    """Return printed numbers as a result has them: tables have shares in percent."""
    shares = {column.key for column in columns if column.unit == "share"}
    return {
        scene: {
            key: (value / 100 if key in shares else value, None, None, None)
            for key, value in part.items()
        }
        for scene, part in row.values.items()
    }
