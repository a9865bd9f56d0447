"""The report's page: its script, what it packs and rounds, and hostile texts."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.report.packing import Blobs, page_json, rounded
from tests.report.made import (
    HOSTILE,
    made_page,
    retrieval_method,
    write_methods,
)


def test_nothing_hostile_gets_out_of_its_text(tmp_path: Path) -> None:
    page = made_page(
        tmp_path, *write_methods(tmp_path, [retrieval_method(HOSTILE, 0)]), "--title", HOSTILE
    )
    assert page.sections[0]["methods"][0]["name"] == HOSTILE
    scripts = re.findall(r"<script[^>]*>", page.text)
    expected = len(page.blobs) + 2
    assert len(scripts) == len(re.findall("</script>", page.text)) == expected
    assert "<img" not in page.text
    assert '<script>document.title="bad"' not in page.text


def test_the_policy_lets_only_this_script_run_and_nothing_load(tmp_path: Path) -> None:
    page = made_page(tmp_path, *write_methods(tmp_path, [retrieval_method("a", 0)]))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page.text)
    script = re.search(r"<script>(.*)</script>", page.text, re.DOTALL)
    assert policy
    assert script
    digest = base64.b64encode(hashlib.sha256(script[1].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy[1]
    assert policy[1].startswith("default-src 'none'; img-src data:;")
    addresses = re.findall(r'(?:src|href)="([^"]*)"', page.text)
    assert all(address.startswith(("data:", "#")) for address in addresses)


def test_without_script_there_are_the_averages(tmp_path: Path) -> None:
    method = retrieval_method("mine", 0)
    page = made_page(tmp_path, *write_methods(tmp_path, [method]))
    static = re.search("<noscript>(.*)</noscript>", page.text, re.DOTALL)
    assert static
    assert "mine" in static[1]
    assert f"{100 * method.result.overall['recall@1']:.2f}" in static[1]


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True, width=64), min_size=1, max_size=40))
def test_rounding_keeps_four_digits(values: list[float]) -> None:
    array = np.array(values)
    found = rounded(array, 4)
    counted = np.isfinite(array) & (np.abs(array) > 1e-130) & (np.abs(array) < 1e130)
    np.testing.assert_array_equal(found[~np.isfinite(array)], array[~np.isfinite(array)])
    np.testing.assert_allclose(found[counted], array[counted], rtol=5.01e-4)
    expected = [float(f"{value:.3e}") for value in found[counted]]
    np.testing.assert_allclose(found[counted], expected, rtol=1e-14)


def test_many_values_are_packed_in_few_bytes() -> None:
    blobs = Blobs()
    values = np.random.default_rng(0).exponential(60, 200_000)
    values[:3] = (np.inf, np.nan, 0.0)
    packed = blobs.numbers(values, lambda different: [str(value) for value in different])
    assert packed["codes"]["type"] == "<u2"
    codes = np.frombuffer(
        zlib.decompress(base64.b64decode(blobs.texts[packed["codes"]["blob"]])), "<u2"
    )
    found = np.array(packed["values"])[codes]
    np.testing.assert_allclose(found[2:], values[2:], rtol=5.01e-4)
    assert found[0] == np.inf
    assert np.isnan(found[1])


@given(st.text(max_size=30))
def test_page_json_comes_back_and_ends_no_element(text: str) -> None:
    made = page_json({"a": [text, float("inf"), float("nan")]})
    assert json.loads(made) == {"a": [text, "inf", None]}
    assert not {"<", ">", "&", "\u2028", "\u2029"} & set(made)
