"""Runs as the data branch keeps them, and boards built of them."""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.build import build_board
from airzoo_bench.leaderboard.data_branch import Run
from airzoo_bench.leaderboard.submission import Submission, submission_text
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from tests.statistics.support import HIT, made_method, write_method
from tests.support import protocol

COLUMNS = (
    HIT,
    HIT.model_copy(update={"key": "recall@5", "title": "R@5"}),
    HIT.model_copy(update={"key": "ap@5", "title": "AP@5"}),
)


def submission(method: str, **fields: Any) -> Submission:
    """Return what is shown of a submission."""
    given: dict[str, Any] = {
        "schema": 1,
        "protocol": "made",
        "method": method,
        "team": "Team",
        "authors": ("Ada Example",),
        "date": datetime.date(2026, 3, 1),
        "licence": "MIT",
        "training_data": ("airzoo",),
        "pipeline": {"stages": "single-stage"},
        "predictions": {"file": "p.npz", "sha256": "0" * 64, "bytes": 10},
    }
    return Submission.model_validate(given | fields)


def method(
    name: str,
    rate: float,
    sizes: Mapping[str, int] = {"east": 30, "west": 20},
    columns: Sequence[ScoreColumn] = COLUMNS,
    seed: int = 0,
    **result: Any,
) -> Scored:
    """Return a method of some skill, whose easy queries are those of the others too."""
    shared, own = np.random.default_rng(7), np.random.default_rng([seed, *name.encode()])
    scenes = {}
    for scene, size in sizes.items():
        ease = 0.7 * shared.random(size) + 0.3 * own.random(size)
        scenes[scene] = {c.key: _values(c, ease, rate).tolist() for c in columns}
    return made_method(scenes, columns, name, **result)


def _values(column: ScoreColumn, ease: np.ndarray, rate: float) -> np.ndarray:
    if column.key.startswith("ap"):
        return np.clip(np.floor(5 * (rate + 0.5 - ease)), 0, 5) / 5
    if column.unit == "share":
        more = 0.2 if column.key == "recall@5" else 0.0
        return (ease < rate + more).astype(float)
    return np.where(ease > 0.95, np.inf, np.round(ease * 30 * (1.5 - rate), 6))


def write_version(
    runs: Path, folder: str, number: int, scored: Scored, *, day: int = 1, **fields: Any
) -> Path:
    """Write a run of the data branch and return its folder."""
    track = scored.result.track
    place = runs / "made" / track / folder / str(number)
    write_method(place, scored)
    given = submission(scored.name, **fields)
    (place / "submission.toml").write_text(submission_text(given), encoding="utf-8")
    when = datetime.datetime(2026, 4, day, 12, tzinfo=datetime.UTC)
    facts = Run(scored=when, commit="c" * 40, tree="d" * 40, version="1")
    (place / "run.json").write_text(facts.model_dump_json(by_alias=True))
    return place


def some_runs(runs: Path, count: int = 4, **options: Any) -> Path:
    """Write so many submissions, the first with an earlier version."""
    for number in range(count):
        made = method(f"Method {number}", 0.25 + 0.5 * number / count, **options)
        write_version(runs, f"m{number}", 2 if number == 0 else 1, made, day=number % 28 + 1)
    first = method("Method 0", 0.1, seed=1, **options)
    write_version(runs, "m0", 1, first)
    return runs


BOARD = Board.model_validate(
    {
        "schema": 1,
        "title": "A board",
        "url": "https://example.org/board",
        "repository": "lab/board",
        "benchmarks": (
            {"name": "made", "title": "Made", "protocols": ("made",)},
            {"name": "uav-visloc", "title": "VisLoc", "protocols": ("uav-visloc-retrieval",)},
        ),
    }
)
PROTOCOL = protocol(name="made", benchmark="made", scenes=({"id": "east", "title": "East"},))


def built(root: Path, out: str = "site", notes: list[str] | None = None) -> Path:
    """Build the board of a folder."""
    place = root / "data/made/protocols/made.toml"
    place.parent.mkdir(parents=True, exist_ok=True)
    values = PROTOCOL.model_dump(mode="json", by_alias=True, exclude_none=True)
    place.write_text(tomli_w.dumps(values), encoding="utf-8")
    note = [].append if notes is None else notes.append
    places = root / "runs", root / "submissions"
    return build_board(*places, BOARD, root / "data", root / out, note)


def files_of(folder: Path) -> dict[str, bytes]:
    """Return all files of a folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def board_of(site: Path) -> Any:
    return json.loads((site / "board.json").read_text(encoding="utf-8"))


def table_of(site: Path, table: str = "made") -> Any:
    return board_of(site)["tables"][table]


def rows_of(site: Path, table: str = "made") -> dict[str, Any]:
    return {row["id"]: row for row in table_of(site, table)["rows"]}
