"""The comment says of a method what the board will say."""

from __future__ import annotations

import base64
import zlib
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.comment import Standing
from airzoo_bench.leaderboard.scoring import find_standing
from airzoo_bench.statistics.significance import LEVEL
from tests.leaderboard.site.support import board_of, built, method, some_runs, write_version


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a board of close and far methods, one measured by another truth."""
    root = tmp_path_factory.mktemp("standing")
    some_runs(root / "runs", 6)
    write_version(root / "runs", "near", 1, method("Near", 0.31))
    write_version(root / "runs", "far", 1, method("Far", 0.9, truth="u" * 64))
    built(root)
    return root


def placed(root: Path, folder: str) -> Standing | None:
    """Return what the comment says."""
    found = find_standing(Place("made", "retrieval", folder), root / "runs", root / "of comment")
    standing: Standing | None = found["standing"]
    return standing


def test_comment_and_board_say_the_same(root: Path) -> None:
    tables = board_of(root / "site")["tables"].values()
    table = next(t for t in tables if any(row["id"] == "near" for row in t["rows"]))
    pairs = table["pairs"]["recall@1"]
    ids, names = pairs["ids"], {row["id"]: row["method"] for row in table["rows"]}
    p_values = np.ones((len(ids), len(ids)))
    upper = np.triu_indices(len(ids), 1)
    p_values[upper] = np.frombuffer(zlib.decompress(base64.b64decode(pairs["p_holm"])), "<f4")
    alike = np.minimum(p_values, p_values.T) > LEVEL
    assert 0 < alike[upper].sum() < len(upper[0])
    for row in [row for row in table["rows"] if row["id"] in ids]:
        standing = placed(root, row["id"])
        own = ids.index(row["id"])
        assert standing is not None
        assert [standing.first, standing.last] == row["scores"]["recall@1"]["rank"]
        assert standing.methods == len(ids) == 7
        others = [names[one] for n, one in enumerate(ids) if n != own and alike[own, n]]
        assert standing.alike == tuple(sorted(others))
