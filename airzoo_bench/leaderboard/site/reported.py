"""Published methods as rows of the board, with what the audit finds of their numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from airzoo_bench.core.files import sha256_of
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.site.api import Finding
from airzoo_bench.leaderboard.site.kept_files import keep_json, kept_json
from airzoo_bench.leaderboard.site.measured import OVERALL
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.method_table import MethodRow, MethodTable, with_published
from airzoo_bench.tables.published import (
    PublishedTable,
    published_sources,
    read_source,
    read_source_file,
)

__all__ = ["Reported", "read_reported"]


@dataclass(frozen=True)
class Reported:
    """All that is published, and what is wrong with it.

    Attributes
    ----------
    findings : mapping of (benchmark, track, method) to sequence of (scene title, Finding)
    """

    tables: Sequence[PublishedTable]
    findings: Mapping[tuple[str, str, str], Sequence[Finding]]

    def rows(
        self,
        benchmark: str,
        track: str,
        columns: Sequence[ScoreColumn],
        scenes: Mapping[str, str],
    ) -> tuple[list[MethodRow], list[str]]:
        """Return the published methods of a benchmark and track, and notes on their numbers."""
        tables = [t for t in self.tables if (t.benchmark, t.track) == (benchmark, track)]
        if not tables:
            return [], []
        empty = MethodTable("", benchmark, track, tuple(columns), scenes, {}, ())
        scenic = any(table.has_scenes for table in tables)
        made = with_published(empty, tables, by_scene=scenic)
        rows = {row.method: row for row in made.rows}
        if scenic:
            for row in with_published(empty, tables, by_scene=False).rows:
                rows.setdefault(row.method, row)
        return [row for row in rows.values() if row.values], list(made.notes)

    def of(
        self, benchmark: str, track: str, method: str, scenes: Mapping[str, str]
    ) -> list[Finding]:
        """Return what is found of a method's cells, scenes by their ids."""
        ids = {title: scene for scene, title in scenes.items()} | {OVERALL: OVERALL}
        return [
            Finding(**{**asdict(one), "scene": ids[one.scene]})
            for one in self.findings.get((benchmark, track, method), ())
            if one.scene in ids
        ]


def read_reported(cache: Path) -> Reported:
    """Read and audit the sources that travel with the package."""
    sources = published_sources()
    findings: dict[tuple[str, str, str], list[Finding]] = {}
    for path in sources.values():
        for benchmark, track, method, finding in _audited(path, cache):
            findings.setdefault((benchmark, track, method), []).append(finding)
    return Reported([table for path in sources.values() for table in read_source(path)], findings)


def _audited(path: Path, cache: Path) -> list[tuple[str, str, str, Finding]]:
    source = read_source_file(path)
    numbers = path.with_name(source.data)
    kept = cache / f"audit-{__version__}-{sha256_of(path)[:32]}-{sha256_of(numbers)[:32]}.json"
    listed = kept_json(kept)
    if listed is None:
        # A build that has the findings needs neither.
        from airzoo_bench.audit.audit import audit
        from airzoo_bench.tables.published import read_published

        listed = [
            [
                source.benchmarks.get(cell.benchmark, ""),
                cell.track,
                cell.method,
                asdict(
                    Finding(
                        OVERALL if cell.is_summary else cell.scene,
                        source.scores.get(cell.track, {}).get(cell.score.name, ""),
                        one.grade.value,
                        one.check,
                        cell.number.text,
                        one.why,
                        ", ".join(filter(None, (source.name, cell.table))),
                    )
                ),
            ]
            for one in audit(read_published(numbers)).findings
            for cell in [one.cell]
        ]
        keep_json(kept, listed)
    return [(b, t, m, Finding(**finding)) for b, t, m, finding in listed]
