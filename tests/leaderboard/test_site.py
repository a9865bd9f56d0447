"""The site: rows, ranks and pairs of board.json; pages, their links, policies and downloads."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import json
import os
import re
import shutil
import zlib
from functools import partial
from itertools import product
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import urldefrag

import numpy as np
import pytest

from airzoo_bench.evaluation.evaluate import evaluate, save
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import answers
from airzoo_bench.leaderboard.pages import bibtex, render_pages, table_csv
from airzoo_bench.leaderboard.pictures import draw_pictures, read_pictures
from airzoo_bench.results.comparison import compare, value_of
from airzoo_bench.results.records import read_methods
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.leaderboard import conftest as world
from tests.leaderboard.conftest import HOME, PROTOCOL, RUNS
from tests.report.browser import NEEDS_CHROMIUM, Opened
from tests.statistics.support import ERROR, HIT, SOFT, made_method

# --- board.json ---


def test_rows_their_facts_numbers_and_history(root: Path) -> None:
    rows = world.rows_of(root / "site")
    assert list(rows) == ["m3", "m2", "m1", "m0"]  # the best first
    [scored] = read_methods([root / RUNS / "m2/1"])
    score, row = rows["m2"]["scores"]["recall@1"], rows["m0"]
    assert score["value"] == value_of(scored, scored.result.columns[0])
    assert 0 < score["low"] < score["value"] < score["high"] < 1
    east = rows["m2"]["scenes"]["east"]["recall@1"]
    assert east[0] == scored.result.scenes["east"]["recall@1"]
    facts = ("kind", "version", "team", "date", "rescored")
    assert [row[key] for key in facts] == ["re-scored", 2, "Team", "2026-03-01", "2026-04-01"]
    assert [one["files"] for one in row["history"]] == [f"{RUNS}/m0/2", f"{RUNS}/m0/1"]
    # Numbers of papers are there from the first day.
    reported = world.rows_of(root / "site", "uav-visloc-retrieval")
    salad = next(row for row in reported.values() if row["method"] == "SALAD")
    assert (salad["kind"], salad["scores"]["recall@1"]["rank"]) == ("reported", None)
    assert "airzoo-paper" in salad["source"]


def unpack_pair(pairs: Any, first: int, second: int) -> list[float]:
    """Return the interval and both p values of two ranked methods, by their places."""
    upper = [*zip(*np.triu_indices(len(pairs["ids"]), 1), strict=True)].index((first, second))
    packed = (zlib.decompress(base64.b64decode(pairs[k])) for k in ("low", "high", "p", "p_holm"))
    return [float(np.frombuffer(numbers, "<f4")[upper]) for numbers in packed]


def test_any_two_as_compare_prints_them(root: Path) -> None:
    scored = read_methods([root / RUNS / f"m{n}/{1 + (n == 0)}" for n in range(4)])
    for column in world.COLUMNS:
        pairs = world.board_of(root / "site")["tables"][PROTOCOL]["pairs"][column.key]
        low, high, p, holm = unpack_pair(pairs, 0, 2)
        first, other = (scored[int(pairs["ids"][n][1:])] for n in (0, 2))
        options: Any = {"reference": other.name, "resampling": ResamplingConfig()}
        [pair] = compare([other, first], [column], **options).pairs
        assert [low, high] == pytest.approx([pair.interval.low, pair.interval.high], rel=1e-5)
        if pair.test.p_value > 0.01:
            assert p == pytest.approx(pair.test.p_value, rel=1e-5)
        assert holm >= p - 1e-6


def test_others_do_not_move_who_cannot_be_told_from_the_best(tmp_path: Path) -> None:
    rates = {"a": 0.6, "b": 0.57, "c": 0.1}
    for more in ({}, {f"x{n}": 0.2 + n / 100 for n in range(12)}):
        for name, rate in (rates | more).items():
            world.write_run(tmp_path, name, 1, world.method(name.upper(), rate))
        rows = world.rows_of(world.built(tmp_path)[0])
        near = [rows[name]["scores"]["recall@1"]["near_best"] for name in rates]
        assert near == [True, True, False]


def test_infinite_medians_conditions_and_an_earlier_truth(tmp_path: Path) -> None:
    columns, later = (ERROR, HIT), {"truth": "u" * 64}
    world.write_run(tmp_path, "early", 1, world.method("Early", 0.9, columns))
    failing = {"error_m": [np.inf] * 25, "recall@1": [0.0] * 25}
    none = made_method({"east": failing, "west": failing}, columns, "None", **later)
    world.write_run(tmp_path, "none", 1, none, day=20)
    for n in range(3):
        made = world.method(f"Net {n}", 0.2 + n / 3, columns, **later)
        made.records["weather"] = np.where(np.arange(50) % 2, "fog", "sun")
        world.write_run(tmp_path, f"n{n}", 1, made, day=20)
    site, _ = world.built(tmp_path)
    rows, text = world.rows_of(site), (site / "board.json").read_text(encoding="utf-8")
    assert list(rows) == ["n2", "n1", "n0", "none", "early"]
    assert (rows["early"]["kind"], rows["n2"]["kind"]) == ("failed", "re-scored")
    score = rows["none"]["scores"]["error_m"]
    assert (score["value"], score["rank"], score["near_best"]) == ("Infinity", [4, 4], False)
    assert "NaN" not in text
    [condition] = json.loads(text)["tables"][PROTOCOL]["conditions"]
    assert (condition["labels"], condition["counts"]) == (["fog", "sun"], [25, 25])
    expected = made.records["recall@1"].to_numpy()[1::2].mean()
    assert rows["n2"]["conditions"]["weather"]["recall@1"][0] == pytest.approx(expected)


def test_what_cannot_be_shown_is_a_row_with_its_reason_and_stops_no_other(tmp_path: Path) -> None:
    world.write_runs(tmp_path, 5)
    runs, reasons = tmp_path / RUNS, {"m1": "run.json", "m2": "submission.toml", "m3": "too late"}
    for name in ("m1/1/run.json", "m2/1/submission.toml", "m0/2/run.json"):
        (runs / name).write_text("{")
    shutil.rmtree(runs / "m3/1")
    (runs / "m3/fault.txt").write_text("p.npz is too late")
    for waiting in ("m4", "waits"):
        (tmp_path / HOME / waiting).mkdir(parents=True)
        (tmp_path / HOME / waiting / "submission.toml").touch()
    (runs / "a b/1").mkdir(parents=True)
    site, notes = world.built(tmp_path)
    rows = world.rows_of(site)
    failed = {one for one, row in rows.items() if row["kind"] == "failed"}
    assert (failed, rows.keys() - failed) == ({*reasons, "waits"}, {"m0", "m4"})
    for name, said in reasons.items():
        assert said in rows[name]["reason"]
        assert any(rows[name]["reason"] in note for note in notes)
    assert rows["m0"]["version"] == 1  # its earlier version is shown
    assert "run.json" in rows["m0"]["notes"][0]


def test_sealed_answers_have_conservative_ranges_and_no_pairs(tmp_path: Path) -> None:
    for unsure, expected in ((0.02, [[1, 2], [1, 2], [3, 3]]), (None, [[1, 2], [1, 3], [2, 3]])):
        for folder, value, error in (("a", 0.9, 0.02), ("b", 0.86, unsure), ("c", 0.4, 0.03)):
            scores = {"recall@1": {"value": value, "standard_error": error}}
            answer, run = world.made_answer(["A"], sealed=True, kind="sealed", scores=scores), "1"
            given = world.submission(method=folder.upper())
            answers.write_run(tmp_path / RUNS / folder / run, given, answer)
        table = world.board_of(world.built(tmp_path)[0])["tables"][PROTOCOL]
        assert (table["sealed"], table["pairs"]) == (True, {})
        assert [row["scores"]["recall@1"]["rank"] for row in table["rows"]] == expected


def test_the_same_bytes_from_nothing_and_from_a_cache(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root / "runs", tmp_path / "runs")
    world.write_run(tmp_path, "m1", 2, world.method("Method 1", 0.9))
    world.built(tmp_path)  # fills the cache, with a method that is not there later
    shutil.rmtree(tmp_path / RUNS / "m1/2")
    assert world.files_of(world.built(tmp_path)[0]) == world.files_of(root / "site")


# --- pages ---

TABLE = f"tables/{PROTOCOL}/"
NAMES = ("SALAD", "Net & Co", "MegaLoc 龍", "a" * 64, "R&D 100 % (3")
TEAMS = ('The "best" team', "O'Neil & {{ 7 * 7 }}", "W" * 64, "Team ${x}", "Größe")
EVIL = "<script>window.caught = 1</script> =1+1 `x` {{ 7919 * 7907 }} "
PICTURE = "data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA="
PICTURES = {
    "clouds": [["East", PICTURE]],
    "maps": [
        {"title": EVIL, "picture": PICTURE, "width": 40, "height": 30, "paths": {"hit": "M1 1z"}}
        | {"hits": 3, "queries": 4, "score": "R@1", "factor": 2}
    ],
    "hardest": [{"query": EVIL, "pictures": [{"title": EVIL, "src": PICTURE}], "values": []}],
}


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of runs of twelve methods; the third one has pictures."""
    root = tmp_path_factory.mktemp("sample")
    links = {"code": "https://example.org/code", "paper": "https://example.org/p?a=1&b=2"}
    for n in range(12):
        name = NAMES[n] if n < len(NAMES) else f"Method {n}"
        made = world.method(name, 0.9 - 0.6 * n / 12, columns=(*world.COLUMNS, SOFT))
        made.records["weather"] = np.where(np.arange(50) < 12, "fog", "sun")
        stages, uses = ("single-stage", "re-ranked")[n % 2], ["prior"][: n % 2]
        facts: dict[str, Any] = {"team": TEAMS[n % 5], "summary": EVIL + "x" * 200}
        facts["training_data"] = ((), ("airzoo", "gta-uav"), ("university-1652",))[n % 3]
        facts |= {"pipeline": {"stages": stages, "uses": uses}} | (links if n % 2 else {})
        world.write_run(root, f"method-{n}", 1 + (n == 2), made, day=n + 1, **facts)
    place = root / RUNS / "method-2/2/figures/pictures.json"
    place.parent.mkdir()
    place.write_text(json.dumps(PICTURES))
    return root


@pytest.fixture(scope="module")
def sample(scored: Path) -> dict[str, Any]:
    """Return a board with scored, reported, failed rows, a floor, and numbers of every kind."""
    board: dict[str, Any] = world.board_of(world.built(scored)[0])
    rows = board["tables"][PROTOCOL]["rows"]
    reason = "p.npz: not a prediction file <img src=x onerror=window.caught=1>\x1b[31m"
    failed = {"id": "failed", "kind": "failed", "scores": {}, "reason": reason, "history": []}
    floor = {"id": "floor-chance", "kind": "floor", "team": ""}
    rows += [*board["tables"]["uav-visloc-retrieval"]["rows"][:2], rows[-1] | floor]
    rows += [rows[-2] | failed]
    rows[3]["scores"]["recall@5"] |= {"value": "Infinity"}
    rows[5]["scores"]["recall@5"] |= {"value": None, "low": None, "high": None}
    rows[1] |= {"source": "=cmd()", "notes": ["2 </script><script>window.caught = 1</script>"]}
    return board


def test_links_lead_to_pages_and_places_and_no_page_loads_or_runs_what_is_not_its_own(
    sample: dict[str, Any], scored: Path
) -> None:
    links, texts = 0, render_pages(sample, scored)
    for path, text in texts.items():
        for address in re.findall(r'href="([^"]*)"', text):
            target, fragment = urldefrag(address)
            joined = os.path.normpath(PurePosixPath(path).parent / target) if target else path
            if not address.startswith(("https://", "data:")) and joined.endswith(".html"):
                links += 1
                place = f'id="{fragment}"' if fragment and "=" not in fragment else ""
                assert place in texts[joined], address
        assert not re.search(r"<[^>]*\s(?:src=(?!\"data:)|style=|on\w+=)", text), path
        assert not re.findall("[\x00-\x08\x0b-\x1f\x7f\u200b-\u200f\u202a-\u202e]", text), path
        assert "62615533" not in text, path  # 7919 * 7907
        outward = re.findall(r'<a [^>]*href="https:[^>]*>', text)
        assert all('rel="noopener nofollow"' in link for link in outward), path
        # The policy allows this style and script by their hashes alone.
        own = re.findall(r"<(?:style|script)>(.*?)</(?:style|script)>", text, re.DOTALL)
        [policy] = re.findall(r'Content-Security-Policy" content="([^"]+)"', text)
        assert policy.startswith("default-src &#39;none&#39;; ")
        assert "unsafe" not in policy
        hashes = [base64.b64encode(hashlib.sha256(c.encode()).digest()).decode() for c in own]
        assert re.findall(r"&#39;sha256-(\S+?)&#39;", policy) == hashes, path
    assert links > 100
    empty = {"rows": [], "pairs": {}, "truth": ""}  # as every board begins
    tables = {name: table | empty for name, table in sample["tables"].items()}
    assert render_pages(sample | {"tables": tables}, Path()).keys() < texts.keys()


def test_csv_has_the_numbers_of_the_board_and_no_name_ends_a_bibtex_entry(sample: Any) -> None:
    table = sample["tables"][PROTOCOL]
    first, *others = csv.DictReader(io.StringIO(table_csv(table)))
    score = table["rows"][0]["scores"]["recall@1"]
    assert float(first["recall@1 value"]) == score["value"]
    assert int(first["recall@1 rank_last"]) == score["rank"][1]
    assert others[0]["source"] == "'=cmd()"
    for text in (r"}, \input{/etc/passwd}", "a} @misc{b", "100 % & $x_1^2$ #~ \\", "@string{x}"):
        facts = {"id": "m", "method": text, "team": text, "authors": [text], "date": "2026-01-01"}
        entry = bibtex(facts | {"paper": None, "code": None, "source": ""}, text)
        assert entry.startswith("@misc{m,\n")
        assert entry.count("{") == entry.count("}")
        assert (entry.count("@"), r"\input" in entry) == (1, False)


@pytest.mark.parametrize("track", ["retrieval", "matching", "reconstruction"])
def test_a_run_keeps_maps_and_the_hardest_queries_or_clouds(
    track: str, host: Path, tmp_path: Path
) -> None:
    found = evaluate(
        world.write_template(track, host, tmp_path), data=host, run=(run := Run(keep=True))
    )
    save(found, tmp_path / "run", partial(draw_pictures, found, run))
    shown = read_pictures(tmp_path, [{"files": "run"}, {"files": "earlier"}])
    assert bool(shown["clouds"]) == (track == "reconstruction")
    for one in shown["maps"]:
        assert 0 <= one["hits"] <= one["queries"] == 5
        dots = [one["paths"][f"{name} dot"].count("M") for name in ("hit", "miss")]
        assert dots == [one["hits"], 5 - one["hits"]]
    assert len(shown["maps"]) == (track != "reconstruction")
    assert [bool(card["pictures"]) for card in shown["hardest"]] == [True] * len(shown["hardest"])
    assert read_pictures(tmp_path, []) == {}


# --- in a browser ---

PAGES = ["index.html", "about.html", f"{TABLE}method-2.html", f"{TABLE}failed.html"]
PAGES += [f"{TABLE}index.html{mark}" for mark in ("", "#part=scenes%2F%2Feast&more=yes")]
PAGES += [f"{TABLE}compare.html#a=method-1&b=method-3"]


@pytest.fixture(scope="module")
def site(sample: Any, scored: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    for path, text in render_pages(sample, scored).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8", newline="")
    return folder


def visit(page: Opened, folder: Path, name: str) -> None:
    path, mark, fragment = name.partition("#")
    page.driver.get("about:blank")  # the same file with another fragment is not opened anew
    page.driver.get((folder / path).as_uri() + mark + fragment)
    if path.endswith("compare.html"):
        page.until(lambda: page.all("#overall tbody tr"))


def column(page: Opened, name: str) -> dict[str, str]:
    """Return what the cells of a column are sorted by, by the row's method, in their order."""
    found: list[list[str]] = page.driver.execute_script(
        "const heads = [...document.querySelectorAll('#results thead th')];"
        "const at = heads.findIndex((h) => h.dataset.name === arguments[0]);"
        "return [...document.querySelectorAll('#results tbody:first-of-type tr')]"
        ".filter((r) => !r.hidden).map((r) => [r.dataset.id, r.cells[at].dataset.v])",
        name,
    )
    return {method: value for method, value in found}  # noqa: C416 - pairs are lists


@NEEDS_CHROMIUM
def test_columns_are_sorted_and_filters_hide_rows_or_show_a_part_instead_of_the_average(
    opened: Opened, site: Path, sample: dict[str, Any]
) -> None:
    visit(opened, site, f"{TABLE}index.html")
    for way in ("descending", "ascending"):
        opened.button('th[data-name="R@5"]', "").click()
        assert opened.one('th[data-name="R@5"]').get_attribute("aria-sort") == way
        *numbers, infinite, missing = column(opened, "R@5").values()
        assert (infinite, missing) == ("inf", "")  # last both ways
        assert numbers == sorted(numbers, key=float, reverse=way == "descending")
    average = column(opened, "R@1")
    opened.choose("#filters", "Rows", "reported, not re-scored")
    assert len(column(opened, "R@1")) == 2
    opened.one("#filters button").click()
    opened.until(lambda: column(opened, "R@1") == average)
    [row] = [row for row in sample["tables"][PROTOCOL]["rows"] if row["id"] == "method-5"]
    fog, east = row["conditions"]["weather"], row["scenes"]["east"]
    for option, part in (("fog (12 queries), few", fog), ("East (30 queries)", east)):
        opened.choose("#filters", "Numbers", option)
        assert float(column(opened, "R@1")["method-5"]) == part["recall@1"][0]
    opened.choose("#filters", "Training data", "without gta-uav")
    assert len(column(opened, "R@1")) == 8  # who says nothing is not without it
    opened.one("input[name=name]").send_keys("MÉTHOD")
    left, address = column(opened, "R@1"), opened.driver.current_url
    assert 0 < len(left) < 8
    opened.driver.get("about:blank")
    opened.driver.get(address)  # which keeps the filters
    assert column(opened, "R@1") == left


@NEEDS_CHROMIUM
@pytest.mark.parametrize(("a", "b"), [(0, 1), (7, 2)])
def test_a_comparison_shows_the_pairs_of_the_board(
    opened: Opened, site: Path, sample: dict[str, Any], a: int, b: int
) -> None:
    made = sample["tables"][PROTOCOL]
    pairs, rows = made["pairs"]["recall@1"], {row["id"]: row for row in made["rows"]}
    one, other = (rows[pairs["ids"][n]] for n in (a, b))
    x, y = (row["scores"]["recall@1"]["value"] for row in (one, other))
    low, high, p, holm = unpack_pair(pairs, min(a, b), max(a, b))
    low, high = (-high, -low) if a > b else (low, high)
    visit(opened, site, f"{TABLE}compare.html#a={one['id']}&b={other['id']}")
    cells = [cell.text for cell in opened.all("#overall tbody tr:first-child td")]
    signed = f"{100 * (x - y):+.2f}", f"{100 * low:+.2f} to {100 * high:+.2f}"
    assert cells[2:4] == [text.replace("-", "−") for text in signed]
    assert cells[5:7] == ["< 0.0001" if v < 0.00005 else f"{v:.4f}" for v in (p, holm)]
    better = "A is better" if x > y else "B is better"
    assert cells[7] == (better if holm <= 0.05 else "cannot be told apart")


# The width of the page, what sticks out of it at the right without a box to scroll in; and what
# strangers' texts have run or loaded.
SEEN = """
const wide = document.documentElement.clientWidth;
return [document.documentElement.scrollWidth - wide, [...document.querySelectorAll("main *")]
  .filter((n) => { const b = n.getBoundingClientRect();
    const inside = n.closest(".scroll, .sr, pre, svg");
    return b.width && (b.right > wide + 1 || b.left < -1) && !inside; })
  .map((n) => n.outerHTML.slice(0, 200)), window.caught || 0,
  performance.getEntriesByType('resource').map((e) => e.name).filter((n) => !n.startsWith("data:"))]
"""
AXE = Path(os.environ.get("AIRZOO_AXE", "node_modules/axe-core/axe.min.js"))
FAULTS = """axe.run().then((r) => arguments[0](r.violations.map((v) =>
 [v.id, v.impact, v.nodes.map((n) => n.html.slice(0, 200))])))"""
SCREENS = [(390, "dark", ""), (320, "light", ""), (1440, "light", ""), (703, "light", "print")]


def show_on(opened: Opened, width: int, scheme: str, media: str) -> None:
    metrics = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": width < 500}
    opened.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    setting = {"media": media, "features": features}
    opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", setting)


@NEEDS_CHROMIUM
@pytest.mark.parametrize(
    ("width", "scheme", "media"),
    [SCREENS[0], *(pytest.param(*one, marks=pytest.mark.slow) for one in SCREENS[1:])],
)
def test_pages_fit_the_screen_and_run_no_strangers_texts(
    opened: Opened, site: Path, width: int, scheme: str, media: str
) -> None:
    show_on(opened, width, scheme, media)
    for name in PAGES:
        visit(opened, site, name)
        assert opened.driver.execute_script(SEEN) == [0, [], 0, []], name


@NEEDS_CHROMIUM
@pytest.mark.skipif(
    not AXE.is_file(), reason="axe-core: npm pack axe-core, AIRZOO_AXE=.../axe.min.js"
)
def test_axe_finds_nothing(opened: Opened, site: Path) -> None:
    for screen, name in product(SCREENS[:3], PAGES):
        show_on(opened, *screen)
        visit(opened, site, name)
        opened.driver.execute_script(AXE.read_text(encoding="utf-8"))
        assert opened.driver.execute_async_script(FAULTS) == [], name
