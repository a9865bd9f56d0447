"""Where methods differ most: order, values, and what stands beside them."""

from __future__ import annotations

import numpy as np

from airzoo_bench.results.records import Scored
from airzoo_bench.tables.differences import differences_table
from tests.statistics.support import ERROR, HIT, SOFT, made_method


def test_order():
    scenes = [
        {"east": {"recall@1": h, "mrr": m}}
        for h, m in (([1, 0, 1, 1], [1.0, 1.0, 1.0, 0.5]), ([0, 0, 1, 0], [0.3, 0.0, 1.0, 0.1]))
    ]
    methods = [made_method(s, (HIT, SOFT), n) for s, n in zip(scenes, "ab", strict=True)]
    table = differences_table(methods, [HIT, SOFT], 10)
    # Two differ by a hit, the first of them by more of MRR; another differs by MRR alone.
    assert table.texts() == [
        ["east/q00000", "100.00", "0.00", "-100.00"],
        ["east/q00003", "100.00", "0.00", "-100.00"],
    ]
    assert table.notes == ("2 of 4 queries differ on R@1", "difference: b minus a")
    assert differences_table(methods, [HIT, SOFT], 1).rows == table.rows[:1]
    by_soft = differences_table(methods, [SOFT], 2)
    assert [row[0] for row in by_soft.texts()] == ["east/q00001", "east/q00000"]


def test_failures_differ_most_and_ids_belong_to_their_scene():
    # Scenes in the order of the protocol, which is not that of the alphabet.
    scenes = [
        {"west": {"error_m": [1.0, 2.0]}, "east": {"error_m": [last, 1.0, 5.0]}}
        for last in (np.inf, 7.0)
    ]
    methods = [made_method(s, (ERROR,), n) for s, n in zip(scenes, "ab", strict=True)]
    methods = [
        Scored(m.name, m.result, m.records.sort_values("query", ignore_index=True)) for m in methods
    ]
    table = differences_table(methods, [ERROR], 5)
    assert table.texts() == [["east/q00000", "inf", "7.00", "-inf"]]
    assert differences_table(methods, [ERROR], 5, "west").texts() == []


def conditioned(name: str, hits: list[float]) -> Scored:
    made = made_method({"s": {"recall@1": hits}}, name=name)
    records = made.records.assign(
        altitude_m=[50.5, 60.0, np.nan], weather=["fog", None, "sun"], first_hit_rank=[1, 2, 3]
    )
    return Scored(name, made.result, records)


def test_conditions_of_two_methods() -> None:
    methods = [conditioned("a", [1.0, 0.0, 1.0]), conditioned("b", [0.0, 1.0, 0.0])]
    table = differences_table(methods, [HIT], 5, base=1)
    heads = [column.heading for column in table.columns]
    assert heads[3:] == ["Difference [%]", "altitude [m]", "weather"]
    assert table.texts() == [
        ["s/q00000", "100.00", "0.00", "100.00", "50.5", "fog"],
        ["s/q00001", "0.00", "100.00", "-100.00", "60", "–"],
        ["s/q00002", "100.00", "0.00", "100.00", "–", "sun"],
    ]
    assert table.notes == ("3 of 3 queries differ on R@1", "difference: a minus b")


def test_more_methods_are_best_and_worst() -> None:
    methods = [
        conditioned(name, [1.0, value, 1.0]) for name, value in zip("abc", (1, 0, 1), strict=True)
    ]
    table = differences_table(methods, [HIT], 5)
    assert [column.title for column in table.columns] == ["Query", "Best to worst", "a", "b", "c"]
    assert table.texts() == [["s/q00001", "100.00", "100.00", "0.00", "100.00"]]
    assert table.notes == ("1 of 3 queries differs on R@1",)


def test_dates_are_not_rounded() -> None:
    methods = [conditioned("a", [1.0, 0.0, 1.0]), conditioned("b", [0.0, 1.0, 0.0])]
    methods = [
        Scored(m.name, m.result, m.records.assign(date=[20240115, 20240116, 20240115]))
        for m in methods
    ]
    texts = differences_table(methods, [HIT], 5).texts()
    assert [row[-1] for row in texts] == ["20240115", "20240116", "20240115"]
