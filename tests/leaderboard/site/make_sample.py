"""Writes a sample of the board's API, of made-up numbers.

Usage: ``python -m tests.leaderboard.site.make_sample OUT [ROWS]``
"""

from __future__ import annotations

import base64
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.leaderboard.site.api import (
    API,
    Benchmark,
    BoardIndex,
    Condition,
    Finding,
    Links,
    MethodFile,
    Pairs,
    Row,
    Scene,
    SceneColumn,
    Score,
    ScoreColumn,
    TableFile,
    TableLink,
    Version,
    as_json,
)

TITLES = {"recall@1": "R@1", "recall@5": "R@5", "ap@5": "AP@5", "ndcg@5": "NDCG@5"}
SCENES = (Scene("city", "City", 40), Scene("rural", "Rural", 38))


def columns(table: str) -> tuple[ScoreColumn, ...]:
    return tuple(
        ScoreColumn(
            key,
            title,
            "share",
            True,
            "mean",
            key != "ndcg@5",
            f"api/v1/tables/{table}/pairs/{n}.json" if key != "ndcg@5" else None,
        )
        for n, (key, title) in enumerate(TITLES.items())
    )


def score(value: float, rank: tuple[int, int] | None, half: float | None) -> Score:
    text = f"{100 * value:.2f}"
    if half is None:
        return Score(value, text)
    low, high = max(0.0, value - half), min(1.0, value + half)
    return Score(value, text, low, high, f"{100 * low:.2f} to {100 * high:.2f}", rank)


def row(n: int, count: int, kind: Any) -> Row:
    value = 0.9 - 0.7 * n / count
    scored = kind in ("re-scored", "sealed")
    rank = (max(1, n - 2), min(count, n + 4)) if scored else None
    names = {
        key: score(value - 0.02 * k, rank, 0.05 if scored and k < 3 else None)
        for k, key in enumerate(TITLES)
    }
    odd = ["SALAD", '<b>Net</b> & "co"', "=cmd()", "MegaLoc 龍"]
    return Row(
        f"method-{n}" if scored else f"{kind}-{n}",
        kind,
        odd[n] if n < len(odd) and scored else f"Method {n}",
        names,
        source="airzoo-paper, tab:uav-visloc" if kind == "reported" else "",
        team=f"Team {n % 5}" if scored else "",
        authors=("Ada Example", "Bo Sample") if scored else (),
        date=f"2026-{1 + n % 11:02}-{1 + n % 27:02}" if scored else None,
        paper="https://example.org/paper" if n % 3 else None,
        code="https://example.org/code" if n % 2 else None,
        licence="Apache-2.0" if scored else None,
        training_data=((), ("airzoo", "gta-uav"), ("university-1652",))[n % 3] if scored else None,
        stages=("single-stage", "re-ranked")[n % 2] if scored else None,
        uses=(("prior",), (), ("sequence",))[n % 3] if scored else (),
        hardware="RTX 4090" if scored and n % 2 else None,
        seconds_per_query=0.01 * (n + 1) if scored and n % 2 else None,
        version=1 + n % 3,
        rescored="2026-11-20" if scored else None,
        notes=("2 queries have no answer",) if n == 1 else (),
        findings=(
            Finding("", "recall@1", "inconsistent", "averages", "61.20", "its scenes give 60.1"),
        )
        if kind == "reported" and n % 2
        else (),
    )


def table(name: str, rows: list[Row], *, current: bool = True, sealed: bool = False) -> TableFile:
    base = f"api/v1/tables/{name}"
    downloads = [f"downloads/{name}.{end}" for end in ("csv", "json", "tex", "md")]
    return TableFile(
        API,
        name,
        "AirZoo-Mini, aerial image retrieval",
        "airzoo-mini",
        "AirZoo-Mini",
        1,
        "retrieval",
        "airzoo-mini-retrieval",
        2,
        "a" * 64,
        "b" * 64,
        sealed,
        current,
        "" if current else "an earlier truth: airzoo-mini v1",
        "query",
        SCENES,
        columns(name),
        tuple(rows),
        ()
        if sealed
        else (Condition("altitude_m", "altitude [m]", ("below 100", "100 and more"), (30, 48)),),
        "Rank ranges: 1 + methods significantly better to N - methods significantly worse; paired "
        "permutation tests, Holm over all pairs of a column, 5 %.",
        "95 % intervals of the average over scenes.",
        ("made with airzoo-bench 0.1.0",),
        Links(f"{base}/scenes.json", None if sealed else f"{base}/conditions.json", *downloads),
    )


def packed(values: Any) -> str:
    return base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()


def files_of(made: TableFile) -> dict[str, Any]:
    base = f"tables/{made.id}"
    scored = [r for r in made.rows if r.kind == "re-scored"]
    files: dict[str, Any] = {f"{base}/table.json": made}
    values = {s.key: [r.scores[s.key].value for r in made.rows] for s in made.scores}
    of_scene = {k: SceneColumn(tuple(v), tuple(v), tuple(v)) for k, v in values.items()}
    files[f"{base}/scenes.json"] = {
        "api": API,
        "table": made.id,
        "scenes": {s.id: of_scene for s in made.scenes},
    }
    if made.conditions:
        files[f"{base}/conditions.json"] = {
            "api": API,
            "table": made.id,
            "conditions": [
                {
                    "by": c.by,
                    "groups": [{k: {"value": v} for k, v in values.items()} for _ in c.labels],
                }
                for c in made.conditions
            ],
        }
    n = len(scored)
    if n > 1 and not made.sealed:
        for place, column in enumerate(made.scores[:3]):
            own = np.array([r.scores[column.key].value for r in scored], float)
            one, two = np.triu_indices(n, 1)
            d = own[one] - own[two]
            p = np.exp(-40 * np.abs(d))
            files[f"{base}/pairs/{place}.json"] = Pairs(
                API,
                column.key,
                tuple(r.id for r in scored),
                tuple(own.tolist()),
                packed(d - 0.05),
                packed(d + 0.05),
                packed(p),
                packed(np.minimum(1, p * len(d))),
                len(d),
                10_000,
                "Paired permutation test.",
            )
    for r in made.rows:
        if r.kind in ("re-scored", "sealed", "reported"):
            history = tuple(
                Version(
                    v,
                    r.id,
                    r.method,
                    r.date,
                    r.rescored,
                    "0.1.0",
                    made.id,
                    r.scores,
                    "R@1 +1.20 points" if v > 1 else "",
                    f"runs/airzoo-mini/retrieval/{r.id}/{v}",
                )
                for v in range(r.version, 0, -1)
            )
            files[f"{base}/methods/{r.id}.json"] = MethodFile(
                API,
                made.id,
                r,
                {s.id: r.scores for s in made.scenes},
                () if r.kind == "reported" else history,
                f"@misc{{{r.id},\n  title = {{Method {r.id}}},\n  year = {{2026}}\n}}\n",
            )
    return files


def sample(count: int = 12) -> dict[str, Any]:
    """Return the sample's files by path below api/v1, as values that JSON has."""
    rows = [row(n, count, "re-scored") for n in range(count)]
    rows += [row(n, 4, "reported") for n in range(4)]
    rows.sort(key=lambda r: -float(r.scores["recall@1"].value or 0))
    tables = [
        table("airzoo-mini-retrieval", [*rows, row(99, 100, "floor")]),
        table("airzoo-mini-retrieval-1f2e3d4c", [row(0, 1, "re-scored")], current=False),
        table("mini-sealed-retrieval", [row(n, 3, "sealed") for n in range(3)], sealed=True),
    ]
    links = [
        TableLink(
            t.id,
            t.title,
            t.track,
            t.protocol,
            2,
            t.sealed,
            t.current,
            t.apart,
            len(t.rows),
            sum(r.kind == "reported" for r in t.rows),
            "2026-11-20",
        )
        for t in tables
    ]
    board = BoardIndex(
        API,
        "A sample board",
        "https://example.org/board",
        "example/board",
        "https://github.com/example/board",
        "https://github.com/example/board/tree/leaderboard-data",
        "2026-11-20",
        "0.1.0",
        (
            Benchmark("airzoo-mini", "AirZoo-Mini", tuple(links[:2])),
            Benchmark("mini-sealed", "AirZoo-Mini, sealed", tuple(links[2:])),
        ),
    )
    files: dict[str, Any] = {"board.json": board}
    for made in tables:
        files |= files_of(made)
    value: dict[str, Any] = as_json(files)
    return value


def main() -> None:
    out, count = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 12
    for path, value in sample(count).items():
        target = out / "api" / "v1" / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(json.dumps(value, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
