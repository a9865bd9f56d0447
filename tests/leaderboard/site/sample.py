"""board.json of many kinds of rows, and the same with texts that want to be more than text."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.leaderboard.pages import render_pages
from tests.leaderboard.site.support import COLUMNS, board_of, built, method, write_version
from tests.statistics.support import SOFT

__all__ = ["ADDRESSES", "TABLE", "TEXTS", "make_sample", "spoilt", "written"]

TABLE = "tables/made/"
NAMES = ("SALAD", "Net & Co", "MegaLoc 龍")


def make_sample(root: Path, count: int = 12) -> dict[str, Any]:
    """Return a board with scored, reported, failed rows, a floor, and numbers of every kind."""
    for n in range(count):
        name = NAMES[n] if n < len(NAMES) else f"Method {n}"
        made = method(name, 0.9 - 0.6 * n / count, columns=(*COLUMNS, SOFT))
        made.records["weather"] = np.where(np.arange(50) < 12, "fog", "sun")
        facts = {
            "team": f"Team {n % 5}",
            "training_data": ((), ("airzoo", "gta-uav"), ("university-1652",))[n % 3],
            "pipeline": {
                "stages": ("single-stage", "re-ranked")[n % 2],
                "uses": ["prior"][: n % 2],
            },
            "summary": "A method.",
        }
        if n % 2:
            facts |= {"code": "https://example.org/code", "paper": "https://example.org/paper"}
        write_version(root / "runs", f"method-{n}", 1, made, day=n + 1, **facts)
    newer = method(NAMES[2], 0.75, columns=(*COLUMNS, SOFT))
    newer.records["weather"] = np.where(np.arange(50) < 12, "fog", "sun")
    write_version(root / "runs", "method-2", 2, newer, day=20)
    board: dict[str, Any] = board_of(built(root))
    table = board["tables"]["made"]
    reported = board["tables"]["uav-visloc-retrieval"]["rows"][:2]
    failed = copy.deepcopy(table["rows"][-1]) | {"id": "failed", "kind": "failed"}
    failed |= {"method": "Failed", "reason": "p.npz: not a prediction file", "scores": {}}
    floor = copy.deepcopy(table["rows"][-1]) | {"id": "floor-chance", "kind": "floor", "team": ""}
    table["rows"] += [*copy.deepcopy(reported), floor, failed]
    table["rows"][3]["scores"]["recall@5"] |= {"value": "Infinity"}
    table["rows"][5]["scores"]["recall@5"] |= {"value": None, "low": None, "high": None}
    table["rows"][1]["notes"] = ["2 queries have no answer"]
    return board


def written(folder: Path, board: dict[str, Any]) -> Path:
    """Write the pages of a board."""
    for path, page in render_pages(board).items():
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(page, encoding="utf-8", newline="")
    return folder


_CALL = "window.caught=(window.caught||0)+1"
TEXTS = (
    f"<script>{_CALL}</script>",
    f"</script><script>{_CALL}</script>",
    f"</title><img src=x onerror={_CALL}>",
    f'"><svg onload="{_CALL}">',
    f"' onmouseover='{_CALL}' x='",
    f"</style><body onload={_CALL}>",
    f"<!--<script>{_CALL}//-->",
    "{{ 7919 * 7907 }}{% for x in () %}",
    "${7919 * 7907} `${7919 * 7907}`",
    "]]></svg>&lt;b&gt;&#60;b&#62;",
    "abc\u202edcba\u2066\u2069\u200f",
    "\x1b[31mred\x1b[0m\x07\x00",
    "\u200b\u3164\u2800",
    " \t\n ",
    "x" * 4000,
    "a b " * 1000,
    "Z" + "\u0335\u0310\u0334" * 200,
    "\ufdfd" * 40,
    "name\u2028other\u2029line\r\nline",
    '=HYPERLINK("https://evil.example","x")',
    '<a href="javascript:alert(1)">x</a>',
    '<meta http-equiv="refresh" content="0;url=https://evil.example/">',
    '<link rel="stylesheet" href="https://evil.example/a.css">',
    '<base href="https://evil.example/">',
)
ADDRESSES = (
    f"javascript:{_CALL}",
    f"JaVaScRiPt:{_CALL}",
    f"data:text/html,<script>{_CALL}</script>",
    f'https://example.org/" onclick="{_CALL}',
    "https://user@evil.example/",
    "https://example.org/a b",
    "http://example.org/",
    "//evil.example/x",
    "https:///nowhere",
    "https://[::1",
    "vbscript:msgbox(1)",
    "https://example.org/\u202egpj.exe",
)
_SPOILT = {
    *("title", "method", "team", "source", "licence", "made_with", "bibtex", "about_intervals"),
    *("benchmark_title", "stages", "summary", "protocol_fingerprint", "truth", "reason"),
}
_LISTS = {"authors", "training_data", "notes", "labels", "uses"}


def spoilt(value: Any) -> Any:
    """Return a board with other texts and addresses."""
    return _spoilt(value, "", cycle(TEXTS), cycle(ADDRESSES))


def _spoilt(value: Any, key: str, texts: Iterator[str], addresses: Iterator[str]) -> Any:
    if isinstance(value, dict):
        return {k: _spoilt(v, k, texts, addresses) for k, v in value.items()}
    if isinstance(value, list) and key in _LISTS:
        return [next(texts) for _ in value]
    if isinstance(value, list):
        return [_spoilt(v, "", texts, addresses) for v in value]
    if key in ("paper", "code", "weights"):
        return next(addresses)
    return next(texts) if key in _SPOILT and isinstance(value, str) else value
