"""The pages as bytes: their links, policies, order, and what is escaped; CSV and BibTeX."""

from __future__ import annotations

import base64
import copy
import csv
import hashlib
import io
import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import urldefrag

import pytest

from airzoo_bench.leaderboard.build import bibtex, table_csv
from airzoo_bench.leaderboard.pages import render_pages, safe_url, shown
from tests.leaderboard.site.sample import ADDRESSES, TABLE, TEXTS, spoilt


class Page(HTMLParser):
    """Tags and texts of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def count(self, tag: str) -> int:
        return sum(found == tag for found, _ in self.tags)

    def values(self, name: str) -> list[str]:
        return [attrs[name] or "" for _, attrs in self.tags if name in attrs]


@pytest.fixture(scope="module")
def texts(sample: dict[str, Any]) -> dict[str, str]:
    return render_pages(sample)


@pytest.fixture(scope="module")
def pages(texts: dict[str, str]) -> dict[str, Page]:
    return {path: Page(text) for path, text in texts.items()}


@pytest.fixture(scope="module")
def hostile(sample: dict[str, Any]) -> dict[str, str]:
    return render_pages(spoilt(sample))


def test_every_relative_link_leads_to_a_page_and_a_place_in_it(pages: dict[str, Page]) -> None:
    links = 0
    for path, page in pages.items():
        for address in page.values("href"):
            if address.startswith(("https://", "data:")):
                continue
            target, fragment = urldefrag(address)
            found = joined(path, target) if target else path
            if found.endswith(("board.json", ".csv")):
                continue
            links += 1
            assert found in pages, (path, address)
            if fragment and "=" not in fragment:
                assert fragment in pages[found].values("id"), (path, address)
    assert links > 100


def joined(page: str, address: str) -> str:
    parts: list[str] = []
    for part in (PurePosixPath(page).parent / address).parts:
        parts = parts[:-1] if part == ".." else [*parts, part]
    return "/".join(parts)


def test_nothing_is_loaded_and_links_away_tell_nothing(
    texts: dict[str, str], pages: dict[str, Page]
) -> None:
    for path, page in pages.items():
        assert page.values("src") == [], path
        tags = Counter(tag for tag, _ in page.tags)
        assert not tags.keys() & {"iframe", "object", "embed", "base", "img", "video", "audio"}
        for tag, attrs in page.tags:
            assert not any(name.startswith("on") or name == "style" for name in attrs), path
            if tag == "a" and (attrs["href"] or "").startswith("https:"):
                assert attrs["rel"] == "noopener nofollow"
        [style] = re.findall(r"<style>(.*?)</style>", texts[path], re.DOTALL)
        assert not re.search(r"url\(|@import", style)


def test_the_policy_allows_this_style_and_script_by_their_hashes_alone(
    texts: dict[str, str],
) -> None:
    for path, page in texts.items():
        policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
        assert policy is not None
        said = policy[1].replace("&#39;", "'")
        assert said.startswith("default-src 'none'; ")
        assert "unsafe" not in said
        scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
        styles = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
        assert (len(styles), len(scripts) <= 1) == (1, True), path
        hashes = [hash_of(content) for content in (*styles, *scripts)]
        assert re.findall(r"'sha256-[^']+'", said) == hashes, path


def hash_of(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def test_reported_and_failed_rows_are_apart(
    texts: dict[str, str],
) -> None:
    page = texts[f"{TABLE}index.html"]
    rows = re.findall(r"<tr data-at.*?</tr>", page, re.DOTALL)
    reported = [row for row in rows if 'class="reported"' in row]
    assert len(reported) == 2
    assert all("reported, not re-scored" in re.sub("<[^>]*>", "", row) for row in reported)
    assert not any("checkbox" in row for row in reported)
    [failed] = [row for row in rows if 'class="failed"' in row]
    assert "p.npz: not a prediction file" in failed
    few = re.findall(r'<option value="\d+" class="few">([^<]*)<', page)
    assert few == ["fog (12 queries), few"]


def test_hostile_texts_make_no_markup_and_show_no_hidden_letter(
    hostile: dict[str, str], pages: dict[str, Page]
) -> None:
    assert hostile.keys() == pages.keys()
    notes = {"section", "h2", "h3", "ul", "li", "b", "p"}  # texts where none stood
    for path, text in hostile.items():
        page, own = Page(text), pages[path]
        for tag in ("script", "style", "title", "body", "meta", "link", "noscript"):
            assert page.count(tag) - own.count(tag) <= (tag == "title") * 99, (path, tag)
        assert {tag for tag, _ in page.tags} <= {tag for tag, _ in own.tags} | notes, path
        assert not any(name.startswith("on") for _, attrs in page.tags for name in attrs), path
        for address in page.values("href"):
            assert not address.lower().startswith(
                ("javascript", "vbscript", "data:t", "http:", "//")
            )
            assert "evil.example" not in address
        hidden = "[\x00-\x08\x0b-\x1f\x7f\u200b-\u200f\u202a-\u202e\u2066-\u2069]"
        assert not re.findall(hidden, text), path
        assert "62615533" not in text, path  # 7919 * 7907


@pytest.mark.parametrize("text", TEXTS)
def test_what_is_shown_is_one_visible_line(text: str) -> None:
    found = shown(text)
    assert found.isprintable()
    assert found.strip()
    assert len(found) <= 300
    assert shown(found) == found


def test_ordinary_names_and_addresses_stay_as_they_are() -> None:
    for name in ("MegaLoc 龍", "Ålesund-Net", "נתיב", "Đặng", "a+b/c (v2)", "देवनागरी"):
        assert shown(name) == name
    for address in ("https://example.org", "https://arxiv.org/abs/2401.1?x=1&y=2#z"):
        assert safe_url(address) == address
    for address in (*ADDRESSES, None, 3, ""):
        assert safe_url(address) is None


def test_a_board_without_any_entry_has_its_pages(sample: dict[str, Any]) -> None:
    board = copy.deepcopy(sample)
    for table in board["tables"].values():
        table |= {"rows": [], "pairs": {}, "truth": ""}
    empty = render_pages(board)
    assert "No entry yet" in empty["index.html"]
    assert "No entry yet" in empty[f"{TABLE}index.html"]
    assert f"{TABLE}compare.html" not in empty
    nothing = sample | {"benchmarks": [], "tables": {}}
    assert "no benchmark yet" in render_pages(nothing)["index.html"]


def test_csv_has_the_numbers_of_the_board(sample: dict[str, Any]) -> None:
    table = copy.deepcopy(sample["tables"]["made"])
    table["rows"][0]["method"] = "=cmd()"
    lines = list(csv.DictReader(io.StringIO(table_csv(table))))
    assert len(lines) == len(table["rows"])
    score = table["rows"][0]["scores"]["recall@1"]
    assert float(lines[0]["recall@1 value"]) == score["value"]
    assert int(lines[0]["recall@1 rank_last"]) == score["rank"][1]
    assert lines[0]["method"] == "'=cmd()"


def row(text: str = "M", own: str = "") -> dict[str, Any]:
    facts = {"id": "m", "method": text, "team": text, "authors": [text], "date": "2026-01-01"}
    return facts | {"paper": None, "code": None, "source": "", "bibtex": own}


@pytest.mark.parametrize(
    "text",
    ["}, \\input{/etc/passwd}", "a} @misc{b", "100 % & $x_1^2$ #~ \\", '"quoted"', "@string{x}"],
)
def test_no_name_ends_a_bibtex_entry(text: str) -> None:
    entry = bibtex(row(text), text)
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
    assert (bibtex(row(own=own), "Board") == own + "\n") == kept
