"""The pages as bytes: their links, policies, order, and what is escaped."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import urldefrag

import pytest

from airzoo_bench.leaderboard.site.pages import render_pages
from airzoo_bench.leaderboard.site.strangers import safe_url, shown
from tests.leaderboard.site.make_sample import sample
from tests.leaderboard.site.pages.hostile import ADDRESSES, TEXTS, spoilt

# Texts where none stood bring notes below a table.
NOTES = {"section", "h2", "h3", "ul", "li", "b"}


class Page(HTMLParser):
    """Tags and texts of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.inside: dict[str, list[str]] = {}
        self._open = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._open = tag

    def handle_endtag(self, tag: str) -> None:
        self._open = ""

    def handle_data(self, data: str) -> None:
        self.inside.setdefault(self._open, []).append(data)

    def count(self, tag: str) -> int:
        return sum(found == tag for found, _ in self.tags)

    def values(self, name: str) -> list[str]:
        return [attrs[name] or "" for _, attrs in self.tags if name in attrs]


@pytest.fixture(scope="module")
def pages() -> dict[str, Page]:
    return {path: Page(text.decode()) for path, text in render_pages(sample()).items()}


@pytest.fixture(scope="module")
def hostile_pages() -> dict[str, Page]:
    return {path: Page(text.decode()) for path, text in render_pages(spoilt(sample(14))).items()}


def test_the_same_files_give_the_same_bytes() -> None:
    files = sample()
    other = json.loads(json.dumps(dict(reversed(files.items()))))
    assert render_pages(files) == render_pages(other)


def test_every_relative_link_leads_to_a_page_and_a_place_in_it(pages: dict[str, Page]) -> None:
    links = 0
    for path, page in pages.items():
        for address in page.values("href"):
            if address.startswith(("https://", "data:")):
                continue
            assert not address.startswith("/"), (path, address)
            target, fragment = urldefrag(address)
            found = joined(path, target) if target else path
            if found.startswith(("api/v1/", "downloads/")):
                continue
            links += 1
            assert found in pages, (path, address)
            if fragment and "=" not in fragment:
                assert fragment in pages[found].values("id"), (path, address)
    assert links > 300


def joined(page: str, address: str) -> str:
    parts: list[str] = []
    for part in (PurePosixPath(page).parent / address).parts:
        parts = parts[:-1] if part == ".." else [*parts, part]
    return "/".join(parts)


def test_nothing_is_loaded_and_links_away_tell_nothing(pages: dict[str, Page]) -> None:
    for path, page in pages.items():
        assert page.values("src") == [], path
        tags = Counter(tag for tag, _ in page.tags)
        assert not tags.keys() & {"iframe", "object", "embed", "base", "img", "video", "audio"}
        for tag, attrs in page.tags:
            assert not any(name.startswith("on") or name == "style" for name in attrs), path
            if tag == "a" and (attrs["href"] or "").startswith("https:"):
                assert attrs["rel"] == "noopener nofollow"
        assert not re.search(r"url\(|@import", "".join(page.inside["style"]))


def test_the_policy_allows_this_style_and_script_by_their_hashes_alone() -> None:
    for path, text in render_pages(sample()).items():
        page = text.decode()
        policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
        assert policy is not None
        said = policy[1].replace("&#39;", "'")
        assert said.startswith("default-src 'none'; ")
        assert "unsafe" not in said
        scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
        styles = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
        assert len(styles) == 1, path
        assert len(scripts) <= 1, path
        hashes = [hash_of(content) for content in (*styles, *scripts)]
        assert re.findall(r"'sha256-[^']+'", said) == hashes, path


def hash_of(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def test_tables_have_captions_and_heads_and_stand_in_the_order_of_the_api(
    pages: dict[str, Page],
) -> None:
    for page in pages.values():
        tags = Counter(tag for tag, _ in page.tags)
        assert tags["table"] == tags["caption"]
        assert all("scope" in attrs for tag, attrs in page.tags if tag == "th")
    table = sample()["tables/airzoo-mini-retrieval/table.json"]
    page = pages["tables/airzoo-mini-retrieval/index.html"]
    assert page.values("data-id") == [row["id"] for row in table["rows"]]


def test_reported_rows_are_apart_and_findings_stand_beside_their_cells() -> None:
    text = render_pages(sample())["tables/airzoo-mini-retrieval/index.html"].decode()
    rows = re.findall(r"<tr data-id.*?</tr>", text, re.DOTALL)
    reported = [row for row in rows if 'class="reported"' in row]
    assert len(reported) == 4
    said = [re.sub("<[^>]*>", "", row) for row in reported]
    assert all("reported, not re-scored" in row for row in said)
    assert not any("checkbox" in row for row in reported)
    found = [row for row in reported if 'class="mark" href="#note-' in row]
    assert len(found) == 2
    assert 'aria-label="†2, note: Method 1, R@1, printed 61.20: its scenes give 60.1' in found[0]
    assert found[0].index("72.50") < found[0].index("#note-2") < found[0].index("70.50")
    assert '<li id="note-2"><b>†2</b> Method 1, R@1, printed 61.20' in text


def test_intervals_are_explained_where_there_are_any() -> None:
    files = sample()
    said = files["tables/airzoo-mini-retrieval/table.json"]["about_intervals"]
    pages = {path: page.decode() for path, page in render_pages(files).items()}
    found = {
        name: said in pages[f"tables/airzoo-mini-retrieval/{name}.html"]
        for name in ("index", "scenes", "scene-1", "conditions", "ranks")
    }
    assert found == {
        "index": True, "scenes": True, "scene-1": True, "conditions": False, "ranks": False
    }  # fmt: skip


def test_hostile_texts_make_no_markup(hostile_pages: dict[str, Page]) -> None:
    plain = render_pages(sample(14))
    assert hostile_pages.keys() == plain.keys()
    for path, page in hostile_pages.items():
        own = Page(plain[path].decode())
        for tag in ("script", "style", "title", "body", "meta", "link", "noscript"):
            assert page.count(tag) <= own.count(tag), (path, tag)
        assert {tag for tag, _ in page.tags} <= {tag for tag, _ in own.tags} | NOTES, path
        names = {name for _, attrs in page.tags for name in attrs}
        assert not any(name.startswith("on") for name in names), path
        for address in page.values("href"):
            assert not address.lower().startswith(
                ("javascript", "vbscript", "data:t", "http:", "//")
            )
            assert "evil.example" not in address


def test_hostile_texts_bring_no_letter_that_is_not_seen() -> None:
    for path, text in render_pages(spoilt(sample(14))).items():
        shown_text = text.decode()
        found = re.findall(
            "[\x00-\x08\x0b-\x1f\x7f\u200b-\u200f\u202a-\u202e\u2066-\u2069]", shown_text
        )
        assert not found, (path, found[:3])
        assert "1337" not in shown_text, path  # 7 * 191


@pytest.mark.parametrize("text", TEXTS)
def test_what_is_shown_is_one_visible_line(text: str) -> None:
    found = shown(text)
    assert found.isprintable()
    assert found.strip()
    assert len(found) <= 300
    assert shown(found) == found


def test_ordinary_names_stay_as_they_are() -> None:
    for name in ("MegaLoc 龍", "Ålesund-Net", "נתיב", "Đặng", "a+b/c (v2)", "देवनागरी"):
        assert shown(name) == name


@pytest.mark.parametrize("address", [*ADDRESSES, None, 3, ""])
def test_other_addresses_than_plain_ones_are_no_links(address: Any) -> None:
    assert safe_url(address) is None


def test_plain_addresses_are_links() -> None:
    for address in ("https://example.org", "https://arxiv.org/abs/2401.1?x=1&y=2#z"):
        assert safe_url(address) == address


def test_a_row_whose_name_leads_elsewhere_is_a_bug() -> None:
    files = sample()
    files["tables/airzoo-mini-retrieval/table.json"]["rows"][0]["id"] = "../../x"
    with pytest.raises(ValueError, match="no plain name"):
        render_pages(files)


def test_each_author_keeps_the_direction_of_the_name() -> None:
    files = sample()
    [row] = [
        r for r in files["tables/airzoo-mini-retrieval/table.json"]["rows"] if r["id"] == "method-2"
    ]
    row["authors"] = ["محمد علي", "Ada Example"]
    page = render_pages(files)["tables/airzoo-mini-retrieval/methods/method-2.html"].decode()
    assert "<bdi>محمد علي</bdi>, <bdi>Ada Example</bdi></dd>" in page


def test_pages_lead_to_the_host_that_the_board_states() -> None:
    files = sample()
    server = "https://git.example.org/lab/board"
    files["board.json"] |= {"repository_url": server, "data_url": f"{server}/-/tree/data"}
    page = render_pages(files)["tables/airzoo-mini-retrieval/methods/method-2.html"].decode()
    assert f'<a href="{server}"' in page
    assert f'"{server}/-/tree/data/runs/' in page
    assert "github" not in page


def test_a_board_without_any_entry_has_its_pages() -> None:
    files = sample()
    for path in files:
        if path.endswith("/table.json"):
            files[path] |= {"rows": [], "truth": ""}
    files = {path: value for path, value in files.items() if "/pairs/" not in path}
    empty = render_pages(files)
    assert b"No entry yet" in empty["index.html"]
    assert b"No entry yet" in empty["tables/airzoo-mini-retrieval/index.html"]
    assert b"no visible text" not in empty["tables/airzoo-mini-retrieval/index.html"]
    for name in ("compare", "scenes", "ranks"):
        assert f"tables/airzoo-mini-retrieval/{name}.html" not in empty
    nothing = {"board.json": files["board.json"] | {"benchmarks": []}}
    assert b"no benchmark yet" in render_pages(nothing)["index.html"]


def test_a_history_draws_only_versions_that_may_be_compared() -> None:
    files = sample()
    versions = files["tables/airzoo-mini-retrieval/methods/method-2.json"]["history"]
    page = "tables/airzoo-mini-retrieval/methods/method-2.html"
    assert len(versions) == 3
    drawn = render_pages(files)[page].decode()
    assert [f"version {n}" in drawn for n in (1, 2, 3)] == [True] * 3
    versions[2]["table"] = "airzoo-mini-retrieval-1f2e3d4c"
    drawn = render_pages(files)[page].decode()
    assert [f"version {n}" in drawn for n in (1, 2, 3)] == [False, True, True]
