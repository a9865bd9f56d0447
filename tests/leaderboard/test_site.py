"""The site: rows, ranks and pairs of board.json; pages, their links, policies and downloads."""

from __future__ import annotations

import base64
import csv
import json
import os
import re
import shutil
import zlib
from itertools import combinations, product
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urldefrag, urljoin

import numpy as np
import pytest

from airzoo_bench.evaluation.evaluate import evaluate, save
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import answers, board, pages, pictures, scoring
from airzoo_bench.report.packing import content_policy
from airzoo_bench.results.comparison import compare
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.leaderboard import conftest as world
from tests.report.browser import NEEDS_CHROMIUM, Opened
from tests.report.made import of_benchmark
from tests.statistics.support import ERROR, HIT, SOFT, made_method, random_methods, write_method

PLACE, PROTOCOL = "uav-visloc/retrieval", "uav-visloc-retrieval"  # of which papers print numbers
EMPTY = "denseuav-drone-to-satellite"
RUNS, TABLE = f"runs/{PLACE}", f"tables/{PROTOCOL}"
COLUMNS, SIZES = (HIT, ERROR, SOFT), {"east": 30, "west": 20}
WORST = {"recall@1": 0.0, "error_m": np.inf, "mrr": 0.0}
FAILS = {scene: {key: [value] * n for key, value in WORST.items()} for scene, n in SIZES.items()}
METHODS = [*random_methods(11, SIZES, COLUMNS, seed=4)[::-1], made_method(FAILS, COLUMNS)]

EVIL = "</script><script>window.caught = 1</script> =1+1 `x` {{ 7919 * 7907 }} "
NAMES = ["SALAD", "Method 1", "MegaLoc 龍", "a" * 64, "9 % & $x_1^2$ #~", "}, {/etc", "a} @misc{b"]
NAMES += ["Method 7", 'The "best"', "O'Neil {{ 7 * 7 }}", "Method 10", "Method ${11}"]
OPEN = {"code": "https://example.org/code", "paper": "https://example.org/p?a=1&b=2"}
OPEN |= {"training_data": (), "pipeline": {"stages": "re-ranked", "uses": ["prior"]}}
KINDS = ({"training_data": ("airzoo", "gta-uav")}, OPEN, {})
PICTURE = "data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA="
MAP = {"title": EVIL, "picture": PICTURE, "width": 40, "height": 30, "paths": {"hit": "M1 1z"}}
MAP |= {"hits": 3, "queries": 4, "score": "R@1", "factor": 2}
HARDEST = {"query": EVIL, "pictures": [{"title": EVIL, "src": PICTURE}], "values": []}
PICTURES = {"clouds": [["East", PICTURE]], "maps": [MAP], "hardest": [HARDEST]}
FILES = {
    f"{RUNS}/method-2/2/figures/pictures.json": json.dumps(PICTURES),
    f"{RUNS}/method-2/3/run.json": "{",
    f"{RUNS}/broken/1/run.json": "{",
    f"{RUNS}/late/fault.txt": f"=p.npz is too late {EVIL}\x1b[31m",
    f"{RUNS}/a b/1/run.json": "",
    f"submissions/{PLACE}/waits/submission.toml": "",
}


def build(root: Path) -> Any:
    """Build the board of a folder with runs and submissions."""
    text = world.BOARD.replace('"made"', '"denseuav"').replace(world.PROTOCOL, EMPTY)
    (file := root / "leaderboard.toml").write_text(text)
    rules, path = board.read_board(file), root / "site"
    notes = pages.build_board(root, root / "submissions", rules, root, path)
    text = (path / "board.json").read_text(encoding="utf-8")
    table = json.loads(text, parse_constant=pytest.fail)["tables"][PROTOCOL]  # no NaN
    rows = {row["id"]: row for row in table["rows"]}
    return SimpleNamespace(root=root, path=path, table=table, rows=rows, notes="\n".join(notes))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return a board of the runs of twelve methods, and of what cannot be shown."""
    root = tmp_path_factory.mktemp("board")
    for n, made in enumerate(METHODS):
        made.records["weather"] = np.where(np.arange(50) < 12, "fog", "sun")
        write_method(run := root / RUNS / f"method-{n}/1", of_benchmark(made, "uav-visloc"))
        answer = scoring.measure(run, "d" * 64)
        answer = answer.model_copy(update={"scored": f"2026-04-{n + 1:02}T12:00:00Z"})
        facts = {"method": NAMES[n], "team": NAMES[n - 5], "summary": EVIL + "x" * 200}
        given = world.submission(protocol=PROTOCOL, **facts | KINDS[n % 3])
        answers.write_run(run, given, answer)
    for copy in ("method-2/2", "method-2/3", "broken/1", "early/1"):
        shutil.copytree(root / RUNS / "method-2/1", root / RUNS / copy)
    early = root / RUNS / "early/1/run.json"
    early.write_text(early.read_text().replace("t" * 64, "e" * 64))  # of another truth
    for path, text in FILES.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(text)
    return build(root)


def test_rows_their_facts_numbers_and_history(site: Any) -> None:
    ranked = [row["scores"] for row in site.table["rows"] if row["kind"] == "re-scored"]
    values = [scores["recall@1"]["value"] for scores in ranked]
    assert (len(values), values) == (12, sorted(values, reverse=True))  # the best first
    row, made = site.rows["method-2"], METHODS[2]
    score = row["scores"]["recall@1"]
    assert score["low"] < score["value"] == made.result.overall["recall@1"] < score["high"]
    assert row["scenes"]["east"]["recall@1"][0] == made.result.scenes["east"]["recall@1"]
    facts = {"version": 2, "team": NAMES[-3], "date": "2026-03-01", "rescored": "2026-04-03"}
    assert row | facts == row
    assert [one["files"] for one in row["history"]] == [f"{RUNS}/method-2/{n}" for n in (2, 1)]
    assert "run.json" in row["notes"][-1]  # the third version is not shown
    fails = site.rows["method-11"]["scores"]["error_m"]
    assert (fails["value"], fails["rank"], fails["near_best"]) == ("Infinity", [10, 12], False)
    [condition] = site.table["conditions"]
    assert (condition["labels"], condition["counts"]) == (["fog", "sun"], [12, 38])
    fog = made.records["recall@1"].to_numpy()[:12].mean()
    assert row["conditions"]["weather"]["recall@1"][0] == pytest.approx(fog)
    printed = site.rows["reported~salad"]
    assert (printed["kind"], printed["scores"]["recall@1"]["rank"]) == ("reported", None)
    assert "airzoo-paper" in printed["source"]


def pairs_of(table: Any, key: str) -> dict[tuple[str, str], list[float]]:
    """Return the interval and both p values of every two methods, as board.json packs them."""
    pairs = table["pairs"][key]
    texts = [base64.b64decode(pairs[name]) for name in ("low", "high", "p", "p_holm")]
    numbers = np.transpose([np.frombuffer(zlib.decompress(text), "<f4") for text in texts])
    return dict(zip(combinations(pairs["ids"], 2), numbers.tolist(), strict=True))


def test_any_two_as_compare_prints_them(site: Any) -> None:
    methods = [METHODS[7], METHODS[2]]
    for pair in compare(methods, COLUMNS[:2], resampling=ResamplingConfig()).pairs:
        low, high, p, holm = pairs_of(site.table, pair.score.key)["method-2", "method-7"]
        expected = [pair.interval.low, pair.interval.high, pair.test.p_value]
        assert [low, high, p] == pytest.approx(expected, rel=1e-5)
        assert holm > p


def test_what_cannot_be_shown_is_a_row_with_its_reason(site: Any) -> None:
    reasons = {"broken": "run.json", "late": "too late", "waits": "submission.toml"}
    reasons |= {"early": "another protocol or truth"}
    assert {one for one, row in site.rows.items() if row["kind"] == "failed"} == {*reasons}
    for name, said in reasons.items():
        assert said in site.rows[name]["reason"]
        assert site.rows[name]["reason"] in site.notes


def test_others_move_nobody_near_the_best_and_a_cache_no_byte(site: Any, tmp_path: Path) -> None:
    few = ("method-0", "method-1", "method-2")  # the last is near only after a correction
    for name in (*few, "method-10"):
        shutil.copytree(site.root / RUNS / name, tmp_path / RUNS / name)
    (tmp_path / RUNS / "method-10").rename(tmp_path / RUNS / "gone")
    for rows in (site.rows, build(tmp_path).rows):
        near = [rows[name]["scores"]["recall@1"]["near_best"] for name in few]
        assert near == [True, True, False]
    shutil.rmtree(tmp_path / RUNS / "gone")
    shutil.copytree(site.root, tmp_path, ignore=shutil.ignore_patterns("site*"), dirs_exist_ok=True)
    assert world.files_of(build(tmp_path).path) == world.files_of(site.path)


def test_sealed_answers_have_conservative_ranges_and_no_pairs(tmp_path: Path) -> None:
    values, errors = (0.9, 0.86, 0.6, 0), (0.02, 0.02, 0.03, None)
    for name, value, error in zip("abcd", values, errors, strict=True):
        scores = {"recall@1": {"value": value, "standard_error": error}}
        answer = world.made_answer(["A"], sealed=True, kind="sealed", scores=scores)
        given = world.submission(method=name, protocol=PROTOCOL)
        answers.write_run(tmp_path / RUNS / name / "1", given, answer)
    site = build(tmp_path)
    assert (site.table["sealed"], site.table["pairs"]) == (True, {})
    ranks = [row["scores"]["recall@1"]["rank"] for row in site.rows.values()]
    assert ranks == [[1, 3], [1, 3], [3, 4], [1, 4]]  # the last is told from no other


def test_links_lead_to_places_and_pages_load_and_run_their_own_alone(site: Any) -> None:
    files = {path.as_uri(): path.read_text("utf-8") for path in site.path.rglob("*.*")}
    for place, text in ((place, files[place]) for place in files if place.endswith(".html")):
        addresses = re.findall(r'href="([^"]*)"', text)
        assert len(addresses) > 5
        for address in addresses:
            target, fragment = urldefrag(urljoin(place, address))
            if target.startswith("file:"):
                assert "=" in fragment or (f'id="{fragment}"' if fragment else "") in files[target]
        assert not re.search(r"<[^>]*\s(?:src=(?!\"data:)|style=|on\w+=)", text), place
        assert not re.search("[\x00-\x08\x0b-\x1f\x7f\u200b-\u200f\u202a-\u202e]", text), place
        assert "62615533" not in text, place  # 7919 * 7907
        assert not re.search(r'<a (?![^>]*rel="noopener nofollow")[^>]*href="https:', text), place
        style, *scripts = re.findall(r"<(?:style|script)>(.*?)</(?:style|script)>", text, re.DOTALL)
        [policy] = re.findall(r'Content-Security-Policy" content="([^"]+)"', text)
        assert policy == content_policy("".join(scripts), style).replace("'", "&#39;"), place
        assert "unsafe" not in policy
    assert "No entry yet" in (site.path / "tables" / EMPTY / "index.html").read_text()


def test_csv_has_the_numbers_of_the_board_and_no_name_ends_a_bibtex_entry(site: Any) -> None:
    rows, file = site.rows, site.path / TABLE / "table.csv"
    lines = {line["id"]: line for line in csv.DictReader(file.read_text("utf-8").split("\n"))}
    score = rows["method-1"]["scores"]["recall@1"]
    assert float(lines["method-1"]["recall@1 value"]) == score["value"]
    assert int(lines["method-1"]["recall@1 rank_last"]) == score["rank"][1]
    assert lines["late"]["reason"] == "'" + rows["late"]["reason"]  # no formula
    for entry in (row["bibtex"] for row in rows.values()):
        assert re.match(r"@misc\{[a-z0-9-]+,\n", entry)
        assert (entry.count("@"), entry.count("{")) == (1, entry.count("}"))
    assert r"9 \% \& \$x\_12\$ \#" in rows["method-4"]["bibtex"]


@pytest.mark.parametrize("track", ["retrieval", "matching", "reconstruction"])
def test_a_run_keeps_its_pictures(track: str, host: Path, tmp_path: Path) -> None:
    path, kept = world.write_template(track, host, tmp_path), Run(keep=True)
    found = evaluate(path, data=host, run=kept)
    save(found, tmp_path / "run", lambda folder: pictures.draw_pictures(found, kept, folder))
    shown = pages.read_pictures(tmp_path, [{"files": "run"}, {"files": "earlier"}])
    kinds = {"clouds"} if track == "reconstruction" else {"maps", "hardest"}
    assert {kind for kind, drawn in shown.items() if drawn} == kinds
    for one in shown["maps"]:
        assert one["width"] == one["height"] > 256  # of a square map of 256 pixels, enlarged
        dots = [one["paths"][f"{name} dot"].count("M") for name in ("hit", "miss")]
        assert (sum(dots), dots[0]) == (one["queries"], one["hits"]) == (5, one["hits"])
    assert all(card["pictures"] for card in shown["hardest"])


@pytest.fixture(scope="module")
def page(site: Any) -> Path:
    return site.path / TABLE / "index.html"  # which `opened` opens


def column(opened: Opened, number: int) -> list[str]:
    """Return the texts of a column of the results, without the four failed rows at its end."""
    return [text for text in opened.column("#results", number)[:-4] if text]


@NEEDS_CHROMIUM
def test_columns_are_sorted_and_rows_filtered(opened: Opened, site: Any) -> None:
    reported = [r["method"] for r in site.table["rows"] if r["kind"] == "reported"]
    row = site.rows["method-7"]
    averages = sorted(column(opened, 4))
    parts, ways = ("average over scenes", "East (30 queries)"), ("ascending", "descending")
    for part, way in product(parts, ways):
        opened.choose("#filters", "Numbers", part)
        opened.button('th[data-name="Median"]', "").click()
        assert opened.one('th[data-name="Median"]').get_attribute("aria-sort") == way
        shown = column(opened, 5)
        numbers = sorted(shown[:11], key=float, reverse=way == "descending")
        assert shown == [*numbers, "inf", *["–"] * len(reported)]  # last both ways
    opened.choose("#filters", "Rows", "reported, not re-scored")
    assert sorted(column(opened, 2)) == sorted(reported)
    opened.one("#filters button").click()
    opened.until(lambda: sorted(column(opened, 4)) == averages)
    fog, east = row["conditions"]["weather"], row["scenes"]["east"]
    for option, part in (("fog (12 queries), few", fog), ("East (30 queries)", east)):
        opened.choose("#filters", "Numbers", option)
        shown = dict(zip(column(opened, 2), column(opened, 4), strict=True))
        assert shown["Method 7"] == f"{100 * part['recall@1'][0]:.2f}"
    opened.choose("#filters", "Training data", "without gta-uav")
    assert "SALAD" not in column(opened, 2)  # who says nothing is not without it
    opened.one("input[name=name]").send_keys("MÉTHOD")
    left = sorted(column(opened, 4))
    assert {*column(opened, 2)} == {"Method 1", "Method 7", "Method 10", "Method ${11}"}
    opened.driver.refresh()  # the address keeps what is shown
    assert sorted(column(opened, 4)) == left


@NEEDS_CHROMIUM
def test_two_that_are_chosen_are_compared_as_the_board_states(opened: Opened, site: Any) -> None:
    for name in ("method-10", "method-0"):
        opened.one(f"[data-id={name}] input").click()
    opened.one(".tray a").click()
    for a, b in (("method-0", "method-10"), ("method-10", "method-0"), ("method-7", "method-2")):
        opened.go(f"a={a}&b={b}")  # the first is there already
        begins = f"R@1: {site.rows[a]['method']} − {site.rows[b]['method']} is "
        opened.until(lambda begins=begins: opened.status("main").startswith(begins))
        for line, score in zip(opened.all("#overall tbody tr"), COLUMNS[:2], strict=True):
            x, y = (site.rows[name]["scores"][score.key]["value"] for name in (a, b))
            low, high, *p_values = pairs_of(site.table, score.key)[min(a, b), max(a, b)]
            low, high = (low, high) if a < b else (-high, -low)
            numbers = [x, y, x - y, low, high] * np.array(100 if score.unit == "share" else 1)
            shown = re.findall(r"[+-]?\d+\.\d+", line.text.replace("−", "-"))
            assert [*map(float, shown[:-2])] == pytest.approx([*numbers], abs=0.0051)
            assert [*map(float, shown[-2:])] == pytest.approx(p_values, abs=0.0001)
            better = "A is better" if (x > y) == score.higher_is_better else "B is better"
            verdict = better if p_values[1] <= 0.05 else "cannot be told apart"
            assert line.text.endswith(verdict)


SCREENS = [(390, "dark", ""), (1440, "light", ""), (320, "light", ""), (703, "light", "print")]
PAGES = ["index.html", "method-2.html", "late.html", "compare.html#a=method-1&b=method-3"]
PAGES += ["index.html#part=scenes%2F%2Feast&more=yes", "../../index.html", "../../about.html"]
AXE = Path(os.environ.get("AIRZOO_AXE", "node_modules/axe-core/axe.min.js"))
FAULTS = "axe.run().then((found) => arguments[0](found.violations))"


@NEEDS_CHROMIUM
@pytest.mark.parametrize("screen", SCREENS)
def test_pages_fit_and_axe_finds_nothing(opened: Opened, page: Path, screen: Any) -> None:
    width, scheme, media = screen
    metrics = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    opened.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    setting = {"media": media, "features": [{"name": "prefers-color-scheme", "value": scheme}]}
    opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", setting)
    for name in PAGES:
        opened.driver.get(f"{page.parent.as_uri()}/{name}")
        opened.until(lambda: not opened.all("#overall tbody:empty"))
        assert opened.driver.execute_script("return document.documentElement.scrollWidth") == width
        if AXE.is_file() and screen in SCREENS[:2]:
            opened.driver.execute_script(AXE.read_text(encoding="utf-8"))
            assert opened.driver.execute_async_script(FAULTS) == [], name
    if not AXE.is_file():
        pytest.skip("pages fit; for axe-core: npm pack axe-core, AIRZOO_AXE=.../axe.min.js")
