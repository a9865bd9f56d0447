"""BibTeX and addresses of a board."""

from __future__ import annotations

import re

import pytest

from airzoo_bench.leaderboard.site.api import Row
from airzoo_bench.leaderboard.site.downloads import bibtex
from airzoo_bench.leaderboard.site.rows import slugs
from tests.leaderboard.site.support import (
    submission,
)


@pytest.mark.parametrize(
    "text",
    ["}, \\input{/etc/passwd}", "a} @misc{b", "100 % & $x_1^2$ #~ \\", '"quoted"', "@string{x}"],
)
def test_no_name_ends_a_bibtex_entry(text: str) -> None:
    row = Row("m", "re-scored", text, {}, team=text, authors=(text,), date="2026-01-01")
    entry = bibtex(row, None, text)
    inner = re.sub(r"\\[{}]", "", entry)
    assert inner.count("{") == inner.count("}")
    assert entry.startswith("@misc{m,\n")
    assert re.sub(r"\{@\}", "", entry).count("@") == 1
    assert r"\input" not in entry


@pytest.mark.parametrize(
    ("own", "kept"),
    [
        ("@article{a, title = {T}}", True),
        ("@article{a, title = {T}} @preamble{x}", False),
        ("@article{a, title = {\\input{x}}}", False),
        ("@article{a}}{", False),
        ("@article{a, title = {^^5cinput{x}}}", False),
        ("@article{a, title = {\\def\\x{\\lstinputlisting{x}}}}", False),
        ("@article{a, title = {\\@input{x}}}", False),
        ('@preamble{"x"}', False),
        ('@Article{a, title = {{S}ALAD in $\\pi^3$}, author = {M\\"uller and {\\L}ukasz}}', True),
    ],
)
def test_an_entry_of_the_authors_is_kept_where_it_is_one(own: str, kept: bool) -> None:
    try:
        stated = submission("M", bibtex=own)
    except ValueError:
        assert not kept
        return
    made = bibtex(Row("m", "re-scored", "M", {}), stated, "Board")
    assert (made == own + "\n") == kept


def test_slugs_do_not_depend_on_the_others_order() -> None:
    assert slugs(["A B", "C"]) == ["a-b", "c"]
    one, other = slugs(["A B", "a b"])
    assert one != other
    assert slugs(["a b", "A B"]) == [other, one]
    assert slugs(["龍", "C"], ["c"])[1].startswith("c-")
