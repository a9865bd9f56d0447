"""What records tell of each list: how long it is, and which tiles stand first."""

from __future__ import annotations

import numpy as np

from airzoo_bench.retrieval.ranking import Ranking
from airzoo_bench.retrieval.scoring import score_scene
from tests.support import MadeScene, made_protocol, made_truth

SCENE = MadeScene("east", [[3], [0], [1, 2]], 9)


def test_the_first_tiles_are_named_rank_by_rank_down_to_the_deepest_recall() -> None:
    tiles = np.array([[3, 1, 8, 7, 6, 5, 4], [2, 0, -1, -1, -1, -1, -1], [-1] * 7], np.int32)
    ranking = Ranking(tiles, np.zeros(3, bool))
    settings = made_protocol([SCENE]).scores
    assert settings.recall_at == (1, 3, 5)
    records = score_scene(made_truth(SCENE), ranking, np.array([True, True, False]), settings)
    names = [f"tile@{rank}" for rank in range(1, 6)]
    assert [name for name in records if str(name).startswith("tile@")] == names
    assert records[names].to_numpy().tolist() == [
        ["east/t00003", "east/t00001", "east/t00008", "east/t00007", "east/t00006"],
        ["east/t00002", "east/t00000", "", "", ""],
        [""] * 5,
    ]
    assert records["ranked"].tolist() == [7, 2, 0]
    assert records["first_hit_rank"].tolist() == [1, 2, 0]
