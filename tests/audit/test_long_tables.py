"""Tables made to take long: how often numbers are compared, whatever time that takes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from airzoo_bench.audit import agreement_checks, gain_checks, order_checks
from tests.audit.support import audited, rows_of

Values = Callable[[int], str]

LENGTHS = (100, 200, 400)


def counted_calls(monkeypatch: pytest.MonkeyPatch, where: object, name: str) -> Counter[str]:
    """Count the calls of a function from here on."""
    calls: Counter[str] = Counter()
    original = getattr(where, name)

    def counting(*args: object) -> object:
        calls[name] += 1
        return original(*args)

    monkeypatch.setattr(where, name, counting)
    return calls


def gains_over(path: Path, methods: int, value: Values, gain: str) -> None:
    """Audit a table in which every method has a gain."""
    values = {f"M{i}": {"City": {"R@1": value(i)}} for i in range(methods)}
    rows = rows_of(values)
    for row in rows[1:]:
        row["gain"] = gain
    audited(path, rows)


def test_gains_over_equal_numbers_are_tried_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = counted_calls(monkeypatch, gain_checks._Gain, "_distance")
    for methods in LENGTHS:
        calls.clear()
        gains_over(tmp_path, methods, lambda i: "50.00", "+0.00")
        assert 0 < calls["_distance"] <= 10 * methods


def test_a_gain_is_compared_with_a_bounded_number_of_rivals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Printed without decimals, it may be over any of very many."""
    methods, calls = 600, counted_calls(monkeypatch, gain_checks, "_explaining")
    compared = counted_calls(monkeypatch, gain_checks._Gain, "_distance")
    gains_over(tmp_path, methods, lambda i: f"{50 + i / 10_000:.4f}", "+1")
    assert calls["_explaining"] == methods - 1
    # Those above and below, and those of the best and of the baseline.
    most = 2 * gain_checks._MOST_NEAR + 20
    assert gain_checks._MOST_NEAR < compared["_distance"] / methods < most


def test_a_long_row_is_not_compared_all_with_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = counted_calls(monkeypatch, order_checks, "at_most")
    for scores in LENGTHS:
        calls.clear()
        audited(tmp_path, rows_of({"A": {"City": {f"R@{k + 1}": "50.0" for k in range(scores)}}}))
        assert 0 < calls["at_most"] <= 2 * order_checks._MOST_NEAR * scores


def test_rows_alike_are_not_compared_all_with_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = counted_calls(monkeypatch, agreement_checks, "_is_another")
    scores = {f"R@{k}": "50.0" for k in (1, 3, 5)}
    for methods in LENGTHS:
        calls.clear()
        rows = [
            row | {"table": table}
            for table in ("one", "other")
            for row in rows_of({f"M{i}": {"City": scores} for i in range(methods // 2)})
        ]
        audited(tmp_path, rows)
        assert 0 < calls["_is_another"] <= (agreement_checks._MOST_PLACES + 1) * methods


def test_of_many_equal_numbers_only_some_are_named(tmp_path: Path) -> None:
    """Each of those that are not bold has a finding; all of the others in each were a square."""
    rows = rows_of({f"M{i}": {"City": {"R@1": "50.00"}} for i in range(60)})
    for row in rows:
        row["bold"] = int(int(str(row["method"])[1:]) < 30)
    found = [f.why for f in audited(tmp_path, rows).findings if f.check == "bold"]
    assert len(found) == 30
    assert found[0].endswith(" and M9 and 20 more is")
