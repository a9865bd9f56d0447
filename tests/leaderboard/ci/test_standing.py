"""The comment says of a method what the board will say."""

from __future__ import annotations

import base64
import zlib
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.scoring import find_standing
from airzoo_bench.statistics.significance import LEVEL
from tests.leaderboard.site.support import (
    PROTOCOL,
    board_of,
    built,
    method,
    some_runs,
    write_version,
)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a board of close and far methods."""
    root = tmp_path_factory.mktemp("standing")
    some_runs(root / "runs", 5)
    write_version(root / "runs", "near", 1, method("Near", 0.31))
    write_version(root / "runs", "far", 1, method("Far", 0.9))
    built(root)
    return root


def test_comment_and_board_say_the_same(root: Path) -> None:
    table = board_of(root / "site")["tables"]["made"]
    pairs, rows = table["pairs"]["recall@1"], {row["id"]: row for row in table["rows"]}
    ids = pairs["ids"]
    p_values, upper = np.ones((len(ids), len(ids))), np.triu_indices(len(ids), 1)
    p_values[upper] = np.frombuffer(zlib.decompress(base64.b64decode(pairs["p_holm"])), "<f4")
    alike = np.minimum(p_values, p_values.T) > LEVEL
    assert 0 < alike[upper].sum() < len(upper[0])
    assert len(ids) == 7
    for own, name in enumerate(ids):
        place = Place("made", "retrieval", name)
        found = find_standing(place, PROTOCOL, root / "runs", root / "of comment")
        assert found["row"].scores["recall@1"].value == rows[name]["scores"]["recall@1"]["value"]
        assert (
            list(found["row"].scores["recall@1"].rank) == rows[name]["scores"]["recall@1"]["rank"]
        )
        others = [rows[one]["method"] for n, one in enumerate(ids) if n != own and alike[own, n]]
        assert (found["ranked"], found["alike"]) == (7, tuple(sorted(others)))
