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
import tomllib
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
from airzoo_bench.leaderboard import answers, scoring
from airzoo_bench.leaderboard.answers import run_folders
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.pages import bibtex, build_board, read_pictures, table_csv
from airzoo_bench.leaderboard.pictures import draw_pictures
from airzoo_bench.results.comparison import compare, value_of
from airzoo_bench.results.records import read_methods
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.leaderboard import conftest as world
from tests.report.browser import NEEDS_CHROMIUM, Opened
from tests.statistics.support import ERROR, HIT, SOFT, made_method, write_method

FIVE = HIT.model_copy(update={"key": "recall@5", "title": "R@5"})
COLUMNS, SIZES = (HIT, FIVE, ERROR, SOFT), {"east": 30, "west": 20}
PLACE, PROTOCOL = "uav-visloc/retrieval", "uav-visloc-retrieval"  # of which papers print numbers
RUNS, TABLE = f"runs/{PLACE}", f"tables/{PROTOCOL}"
OTHER = {"name": "denseuav", "title": "None", "protocols": ["denseuav-drone-to-satellite"]}
NAMES = ("SALAD", "Net & Co", "MegaLoc 龍", "a" * 64, "R&D 100 % (3")
TEAMS = ('The "best" team', "O'Neil & {{ 7 * 7 }}", "W" * 64, "Team ${x}", "Größe")
EVIL = "</script><script>window.caught = 1</script> =1+1 `x` {{ 7919 * 7907 }} "
PICTURE = "data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA="
MAP = {"title": EVIL, "picture": PICTURE, "width": 40, "height": 30, "paths": {"hit": "M1 1z"}}
MAP |= {"hits": 3, "queries": 4, "score": "R@1", "factor": 2}
HARDEST = {"query": EVIL, "pictures": [{"title": EVIL, "src": PICTURE}], "values": []}
PICTURES = {"clouds": [["East", PICTURE]], "maps": [MAP], "hardest": [HARDEST]}


def write_run(root: Path, folder: str, rate: float, number: int = 1, **facts: Any) -> None:
    """Write a run of a skill from 0, where all fails, to 1, of an earlier truth."""
    shared, own = np.random.default_rng(7), np.random.default_rng([0, *folder.encode()])
    scenes = {}
    for scene, size in SIZES.items():
        ease = 0.7 * shared.random(size) + 0.3 * own.random(size)
        made = {c.key: ease < rate + 0.2 * (c is FIVE and rate > 0) for c in COLUMNS}
        made["error_m"] = np.where((ease > 0.95) | (rate == 0), np.inf, ease * 30 * (1.5 - rate))
        scenes[scene] = {key: one.astype(float).tolist() for key, one in made.items()}
    given = world.submission(**({"method": folder, "protocol": PROTOCOL} | facts))
    method = made_method(scenes, COLUMNS, given.method, truth="te"[rate == 1] * 64)
    method.records["weather"] = np.where(np.arange(50) < 12, "fog", "sun")
    write_method(run := root / RUNS / folder / str(number), method)
    found = scoring.measure(run, "d" * 64)
    floor = answers.make_row({HIT.key: 0.1}, {}, kind="floor", method="chance")
    changes = {"scored": f"2026-04-{round(30 - 28 * rate):02}T12:00:00Z", "floors": (floor,)}
    changes |= {"head": found.head.model_copy(update={"benchmark": "uav-visloc"})}
    answers.write_run(run, given, found.model_copy(update=changes))


def build(root: Path) -> tuple[Path, list[str]]:
    """Build the board of a folder with runs and submissions; return the site and the notes."""
    values = tomllib.loads(world.BOARD)
    board = Board.model_validate(values | {"benchmarks": [values["benchmarks"][0], OTHER]})
    return root / "site", build_board(root, root / "submissions", board, root, root / "site")


def table_of(root: Path) -> tuple[Any, dict[str, Any]]:
    """Return the table of a built board, and its rows by id."""
    text = (root / "site/board.json").read_text(encoding="utf-8")
    assert "NaN" not in text
    table = json.loads(text)["tables"][PROTOCOL]
    return table, {row["id"]: row for row in table["rows"]}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the runs of twelve methods and of what cannot be shown, and the site."""
    root = tmp_path_factory.mktemp("board")
    links = {"code": "https://example.org/code", "paper": "https://example.org/p?a=1&b=2"}
    for n in range(12):
        facts: dict[str, Any] = {"team": TEAMS[n % 5], "summary": EVIL + "x" * 200}
        facts["method"] = NAMES[n] if n < len(NAMES) else f"Method {n}"
        facts["training_data"] = ((), ("airzoo", "gta-uav"), ("university-1652",))[n % 3]
        stages, uses = ("single-stage", "re-ranked")[n % 2], ["prior"][: n % 2]
        facts |= {"pipeline": {"stages": stages, "uses": uses}} | (links if n % 2 else {})
        for number in (1, 2) if n == 2 else (1,):
            write_run(root, f"method-{n}", (0.9 - n / 20) * (n < 11), number, **facts)
    write_run(root, "early", 1.0)
    for path in ("method-2/3/run.json", "answer/1/run.json", "stated/1/submission.toml"):
        shutil.copytree(root / RUNS / "method-3/1", (root / RUNS / path).parent)
        (root / RUNS / path).write_text("{")
    for path, text in {
        "late/fault.txt": f"p.npz is too late {EVIL}\x1b[31m",
        "method-2/2/figures/pictures.json": json.dumps(PICTURES),
        "a b/1/run.json": "",
    }.items():
        (root / RUNS / path).parent.mkdir(parents=True)
        (root / RUNS / path).write_text(text)
    (waits := root / "submissions" / PLACE / "waits").mkdir(parents=True)
    (waits / "submission.toml").touch()
    (root / "notes.txt").write_text("\n".join(build(root)[1]))
    return root


def test_rows_their_facts_numbers_and_history(root: Path) -> None:
    table, rows = table_of(root)
    ranked = [row["scores"] for row in table["rows"] if row["kind"] == "re-scored"]
    values = [scores["recall@1"]["value"] for scores in ranked]
    assert (len(values), values) == (12, sorted(values, reverse=True))  # the best first
    [scored] = read_methods([root / RUNS / "method-2/2"])
    row, score = rows["method-2"], rows["method-2"]["scores"]["recall@1"]
    assert score["value"] == value_of(scored, HIT)
    assert 0 < score["low"] < score["value"] < score["high"] < 1
    assert row["scenes"]["east"]["recall@1"][0] == scored.result.scenes["east"]["recall@1"]
    facts = ("kind", "version", "team", "date", "rescored")
    assert [row[key] for key in facts] == ["re-scored", 2, TEAMS[2], "2026-03-01", "2026-04-08"]
    assert [one["files"] for one in row["history"]] == [f"{RUNS}/method-2/{n}" for n in (2, 1)]
    fails = rows["method-11"]["scores"]["error_m"]
    assert [fails[key] for key in ("value", "rank", "near_best")] == ["Infinity", [12, 12], False]
    [condition] = table["conditions"]
    assert (condition["labels"], condition["counts"]) == (["fog", "sun"], [12, 38])
    fog = scored.records["recall@1"].to_numpy()[:12].mean()
    assert row["conditions"]["weather"]["recall@1"][0] == pytest.approx(fog)
    # Numbers of papers are there from the first day.
    [salad] = [row for row in table["rows"] if row["method"] == "SALAD" and row["source"]]
    assert (salad["kind"], salad["scores"]["recall@1"]["rank"]) == ("reported", None)
    assert "airzoo-paper" in salad["source"]


def unpack_pair(pairs: Any, first: int, second: int) -> list[float]:
    """Return the interval and both p values of two ranked methods, by their places."""
    upper = [*zip(*np.triu_indices(len(pairs["ids"]), 1), strict=True)].index((first, second))
    packed = (zlib.decompress(base64.b64decode(pairs[k])) for k in ("low", "high", "p", "p_holm"))
    return [float(np.frombuffer(numbers, "<f4")[upper]) for numbers in packed]


def test_any_two_as_compare_prints_them(root: Path) -> None:
    for column, places in product((HIT, FIVE, ERROR), ((0, 2), (3, 5))):
        pairs = table_of(root)[0]["pairs"][column.key]
        folders = [root / RUNS / pairs["ids"][n] for n in places]
        first, other = read_methods([run_folders(folder)[-1] for folder in folders])
        options: Any = {"reference": other.name, "resampling": ResamplingConfig()}
        [pair] = compare([other, first], [column], **options).pairs
        low, high, p, holm = unpack_pair(pairs, *places)
        assert [low, high] == pytest.approx([pair.interval.low, pair.interval.high], rel=1e-5)
        assert pair.test.p_value < 0.01 or p == pytest.approx(pair.test.p_value, rel=1e-5)
        assert holm >= p - 1e-6


def test_what_cannot_be_shown_is_a_row_with_its_reason_and_stops_no_other(root: Path) -> None:
    rows, notes = table_of(root)[1], (root / "notes.txt").read_text()
    reasons = {"answer": "run.json", "stated": "submission.toml", "late": "too late"}
    reasons |= {"waits": "submission.toml", "early": "another protocol or truth"}
    assert {one for one, row in rows.items() if row["kind"] == "failed"} == {*reasons}
    for name, said in reasons.items():
        assert said in rows[name]["reason"]
        assert rows[name]["reason"] in notes
    assert "run.json" in rows["method-2"]["notes"][-1]  # its earlier version is shown


def test_others_move_nobody_near_the_best_and_a_cache_no_byte(root: Path, tmp_path: Path) -> None:
    few = ("method-0", "method-1", "method-4")  # the last is near only after a correction
    for name in few:
        shutil.copytree(root / RUNS / name, tmp_path / RUNS / name)
    write_run(tmp_path, "gone", 0.5)
    build(tmp_path)
    for rows in (table_of(at)[1] for at in (root, tmp_path)):
        near = [rows[name]["scores"]["recall@1"]["near_best"] for name in few]
        assert near == [True, True, False]
    shutil.rmtree(tmp_path / RUNS / "gone")
    for part in ("runs", "submissions"):
        shutil.copytree(root / part, tmp_path / part, dirs_exist_ok=True)
    assert world.files_of(build(tmp_path)[0]) == world.files_of(root / "site")


def test_sealed_answers_have_conservative_ranges_and_no_pairs(tmp_path: Path) -> None:
    for unsure, expected in ((0.02, [[1, 2], [1, 2], [3, 3]]), (None, [[1, 2], [1, 3], [2, 3]])):
        for folder, value, error in (("a", 0.9, 0.02), ("b", 0.86, unsure), ("c", 0.4, 0.03)):
            scores = {"recall@1": {"value": value, "standard_error": error}}
            answer = world.made_answer(["A"], sealed=True, kind="sealed", scores=scores)
            given = world.submission(method=folder.upper(), protocol=PROTOCOL)
            answers.write_run(tmp_path / RUNS / folder / "1", given, answer)
        build(tmp_path)
        table, rows = table_of(tmp_path)
        assert (table["sealed"], table["pairs"]) == (True, {})
        assert [row["scores"]["recall@1"]["rank"] for row in rows.values()] == expected


def test_links_lead_to_places_and_pages_load_and_run_their_own_alone(root: Path) -> None:
    links, site = 0, root / "site"
    texts = {p.relative_to(site).as_posix(): p.read_text("utf-8") for p in site.rglob("*.html")}
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
    assert "No entry yet" in texts[f"tables/{OTHER['protocols'][0]}/index.html"]


def test_csv_has_the_numbers_of_the_board_and_no_name_ends_a_bibtex_entry(root: Path) -> None:
    table = table_of(root)[0]
    score = table["rows"][0]["scores"]["recall@1"]
    table["rows"][1]["source"] = "=cmd()"
    first, second, *_ = csv.DictReader(io.StringIO(table_csv(table)))
    assert float(first["recall@1 value"]) == score["value"]
    assert int(first["recall@1 rank_last"]) == score["rank"][1]
    assert second["source"] == "'=cmd()"
    for text in (r"}, \input{/etc/passwd}", "a} @misc{b", "100 % & $x_1^2$ #~ \\", "@string{x}"):
        facts = {"id": "m", "method": text, "team": text, "authors": [text], "date": "2026-01-01"}
        entry = bibtex(facts | {"paper": None, "code": None, "source": ""}, text)
        assert entry.startswith("@misc{m,\n")
        assert entry.count("{") == entry.count("}")
        assert (entry.count("@"), r"\input" in entry) == (1, False)


@pytest.mark.parametrize("track", ["retrieval", "matching", "reconstruction"])
def test_a_run_keeps_its_pictures(track: str, host: Path, tmp_path: Path) -> None:
    path, kept = world.write_template(track, host, tmp_path), Run(keep=True)
    found = evaluate(path, data=host, run=kept)
    save(found, tmp_path / "run", partial(draw_pictures, found, kept))
    shown = read_pictures(tmp_path, [{"files": "run"}, {"files": "earlier"}])
    by_query = track != "reconstruction"
    assert (len(shown["maps"]), bool(shown["clouds"])) == (by_query, not by_query)
    for one in shown["maps"]:
        assert 0 <= one["hits"] <= one["queries"] == 5
        dots = [one["paths"][f"{name} dot"].count("M") for name in ("hit", "miss")]
        assert dots == [one["hits"], 5 - one["hits"]]
    assert [bool(card["pictures"]) for card in shown["hardest"]] == [True] * len(shown["hardest"])
    assert read_pictures(tmp_path, []) == {}


SCREENS = [(390, "dark", ""), (320, "light", ""), (1440, "light", ""), (703, "light", "print")]
PAGES = ["index.html", "about.html", f"{TABLE}/method-2.html", f"{TABLE}/late.html"]
PAGES += [f"{TABLE}/index.html{mark}" for mark in ("", "#part=scenes%2F%2Feast&more=yes")]
PAGES += [f"{TABLE}/compare.html#a=method-1&b=method-3"]


@pytest.fixture(scope="module")
def page(root: Path) -> Path:
    return root / "site/index.html"  # which `opened` opens


def visit(opened: Opened, root: Path, name: str, screen: Any = (1280, "light", "")) -> None:
    """Open another page of the site on a screen of a width, a colour scheme and a medium."""
    width, scheme, media = screen
    metrics = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": width < 500}
    opened.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    setting = {"media": media, "features": features}
    opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", setting)
    path, mark, fragment = name.partition("#")
    opened.driver.get("about:blank")  # the same file with another fragment is not opened anew
    opened.driver.get((root / "site" / path).as_uri() + mark + fragment)
    if path.endswith("compare.html"):
        opened.until(lambda: opened.all("#overall tbody tr"))


def column(opened: Opened, name: str) -> dict[str, str]:
    """Return what the cells of a column are sorted by, by the row's method, in their order."""
    found = opened.driver.execute_script(
        "const heads = [...document.querySelectorAll('#results thead th')];"
        "const at = heads.findIndex((h) => h.dataset.name === arguments[0]);"
        "return [...document.querySelectorAll('#results tbody:first-of-type tr')]"
        ".filter((r) => !r.hidden).map((r) => [r.dataset.id, r.cells[at].dataset.v])",
        name,
    )
    return dict(found)


@NEEDS_CHROMIUM
def test_columns_are_sorted_and_rows_filtered(opened: Opened, root: Path) -> None:
    table, rows = table_of(root)
    reported = sum(row["kind"] == "reported" for row in table["rows"])
    visit(opened, root, f"{TABLE}/index.html")
    for way in ("ascending", "descending"):
        opened.button('th[data-name="Median"]', "").click()
        assert opened.one('th[data-name="Median"]').get_attribute("aria-sort") == way
        shown = [*column(opened, "Median").values()]
        numbers = sorted(shown[:11], key=float, reverse=way == "descending")
        assert shown == [*numbers, "inf", *[""] * reported]  # last both ways
    average = column(opened, "R@1")
    opened.choose("#filters", "Rows", "reported, not re-scored")
    assert len(column(opened, "R@1")) == reported
    opened.one("#filters button").click()
    opened.until(lambda: column(opened, "R@1") == average)
    fog, east = rows["method-5"]["conditions"]["weather"], rows["method-5"]["scenes"]["east"]
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
@pytest.mark.parametrize(("a", "b"), [(0, 3), (7, 2)])
def test_two_are_compared_as_the_board_states(opened: Opened, root: Path, a: int, b: int) -> None:
    table, rows = table_of(root)
    pairs = table["pairs"]["recall@1"]
    one, other = (pairs["ids"][n] for n in (a, b))
    x, y = (rows[name]["scores"]["recall@1"]["value"] for name in (one, other))
    low, high, p, holm = unpack_pair(pairs, min(a, b), max(a, b))
    low, high = (-high, -low) if a > b else (low, high)
    visit(opened, root, f"{TABLE}/compare.html#a={one}&b={other}")
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


@NEEDS_CHROMIUM
@pytest.mark.parametrize(
    "screen", [SCREENS[0], *(pytest.param(one, marks=pytest.mark.slow) for one in SCREENS[1:])]
)
def test_pages_fit_and_run_no_strangers_texts(opened: Opened, root: Path, screen: Any) -> None:
    for name in PAGES:
        visit(opened, root, name, screen)
        assert opened.driver.execute_script(SEEN) == [0, [], 0, []], name


@NEEDS_CHROMIUM
@pytest.mark.skipif(
    not AXE.is_file(), reason="axe-core: npm pack axe-core, AIRZOO_AXE=.../axe.min.js"
)
def test_axe_finds_nothing(opened: Opened, root: Path) -> None:
    for screen, name in product(SCREENS[:3], PAGES):
        visit(opened, root, name, screen)
        opened.driver.execute_script(AXE.read_text(encoding="utf-8"))
        assert opened.driver.execute_async_script(FAULTS) == [], name
