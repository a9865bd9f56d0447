"""Feed, BibTeX and addresses of a board."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import pytest

from airzoo_bench.leaderboard.site.api import Row
from airzoo_bench.leaderboard.site.downloads import News, atom_feed, bibtex
from airzoo_bench.leaderboard.site.rows import slugs
from tests.leaderboard.site.support import (
    submission,
)


def test_the_feed_is_atom_with_ids_that_stay() -> None:
    news = [
        News(f"runs/a/b/c/{n}", f"2026-04-0{n}", "<b>\x00&", "Team", "made", "R@1 50.00", "x.html")
        for n in (1, 2)
    ]
    feed = ET.fromstring(atom_feed("Board", "https://example.org/b", news))
    space = {"a": "http://www.w3.org/2005/Atom"}
    assert feed.findtext("a:updated", None, space) == "2026-04-02T00:00:00Z"
    entries = feed.findall("a:entry", space)
    assert [e.findtext("a:updated", None, space) for e in entries] == [
        "2026-04-02T00:00:00Z", "2026-04-01T00:00:00Z",
    ]  # fmt: skip
    assert entries[0].findtext("a:title", None, space) == "<b>\N{REPLACEMENT CHARACTER}& on made"
    again = ET.fromstring(atom_feed("Board", "https://example.org/b", news[:1]))
    assert again.find("a:entry", space).findtext("a:id", None, space) == entries[1].findtext(  # type: ignore[union-attr]
        "a:id", None, space
    )
    assert ET.fromstring(atom_feed("Board", None, [])) is not None


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
