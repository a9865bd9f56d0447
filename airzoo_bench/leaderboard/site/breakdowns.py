"""A table's scores by scene and by condition, in the order of its rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from airzoo_bench.leaderboard.site import api
from airzoo_bench.leaderboard.site.api import API, Row, TableFile
from airzoo_bench.leaderboard.site.rows import Scored, Scores

__all__ = ["by_condition", "by_scene"]

_GROUPS = "labels", "members"  # what two results that have the same groups of queries share


def by_scene(table: TableFile, rows: Mapping[str, Scores]) -> dict[str, Any]:
    """Return scenes.json: each score of each scene, in the order of the rows."""

    def column(scene: str, key: str) -> api.SceneColumn:
        scores = [found.get(scene, {}).get(key) for found in rows.values()]
        parts = [
            tuple(None if one is None else getattr(one, name) for one in scores)
            for name in ("value", "low", "high")
        ]
        none = all(one is None for one in parts[1])
        return api.SceneColumn(parts[0], () if none else parts[1], () if none else parts[2])

    scenes = {s.id: {c.key: column(s.id, c.key) for c in table.scores} for s in table.scenes}
    return {"api": API, "table": table.id, "scenes": scenes}


def by_condition(
    table: TableFile, conditions: Sequence[Mapping[str, Any]], methods: Sequence[Scored]
) -> dict[str, Any]:
    """Return conditions.json: each headline score in each group, in the order of the rows."""
    own = {one.id: {c["by"]: c for c in one.measured.conditions} for one in methods}

    def value(row: Row, condition: Mapping[str, Any], group: int, key: str) -> Any:
        found = own.get(row.id, {}).get(condition["by"])
        alike = found is not None and all(found[name] == condition[name] for name in _GROUPS)
        if found is None or not alike or key not in found["values"]:
            return None
        return found["values"][key][group]

    return {
        "api": API,
        "table": table.id,
        "conditions": [
            {
                "by": condition["by"],
                "groups": [
                    {
                        c.key: {
                            "value": [value(row, condition, group, c.key) for row in table.rows]
                        }
                        for c in table.scores
                        if c.headline
                    }
                    for group in range(len(condition["labels"]))
                ],
            }
            for condition in conditions
        ],
    }
