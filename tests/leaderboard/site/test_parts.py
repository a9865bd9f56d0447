"""Faults, sealed answers, the ledger of reproductions, feed, BibTeX; and serving."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.leaderboard.site.api import Row, Score
from airzoo_bench.leaderboard.site.downloads import News, atom_feed, bibtex
from airzoo_bench.leaderboard.site.entries import Faults, read_entries, waiting
from airzoo_bench.leaderboard.site.reported import read_reported
from airzoo_bench.leaderboard.site.reproductions import Link, find_reproductions, read_links
from airzoo_bench.leaderboard.site.rows import slugs
from tests.leaderboard.site.make_sample import row as sample_row
from tests.leaderboard.site.make_sample import table as sample_table
from tests.leaderboard.site.support import (
    COLUMNS,
    built,
    given,
    method,
    some_runs,
    submission,
    write_version,
)
from tests.statistics.support import write_method


def spoil(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


RUN = "runs/made/retrieval/m1/1"
FAULTS: list[tuple[str, Callable[[Path], object], str]] = [
    ("damaged", lambda run: (run / "result.json").write_text("{"), "result.json: not a result"),
    (
        "edited",
        lambda run: spoil(run / "result.json", '"method": "Method 1"', '"method": "Method X"'),
        "the checksum does not fit",
    ),
    ("records gone", lambda run: (run / "records.csv").unlink(), "records.csv: no such file"),
    (
        "records edited",
        lambda run: spoil(run / "records.csv", "1.0", "0.0"),
        "not the records of the result",
    ),
    ("no result", lambda run: (run / "result.json").unlink(), "neither result.json nor answer"),
    ("no submission", lambda run: (run / "submission.toml").unlink(), "no such submission file"),
    ("no run", lambda run: (run / "run.json").unlink(), "no such run file"),
    ("other version", lambda run: (run.parent / "latest").mkdir(), "holds what is no version"),
    ("empty", lambda run: (run.parent.parent / "void").mkdir(), "holds no versions"),
    (
        "other protocol",
        lambda run: spoil(run / "submission.toml", 'protocol = "made"', 'protocol = "other"'),
        "submitted for other",
    ),
    (
        "other place",
        lambda run: (run.parent.parent.parent).rename(run.parents[3] / "else"),
        "is of made (retrieval)",
    ),
]


@pytest.mark.parametrize(
    ("spoiled", "message"), [f[1:] for f in FAULTS], ids=[f[0] for f in FAULTS]
)
def test_each_fault_is_named_and_the_board_stays(
    tmp_path: Path, spoiled: Callable[[Path], object], message: str
) -> None:
    some_runs(tmp_path / "runs", 2)
    (tmp_path / "site/api/v1").mkdir(parents=True)
    (tmp_path / "site/api/v1/board.json").touch()
    spoiled(tmp_path / RUN)
    with pytest.raises(UserError) as error:
        built(tmp_path)
    assert message in str(error.value)
    assert [path.name for path in (tmp_path / "site").rglob("*.json")] == ["board.json"]


def test_all_faults_in_one_message(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 4)
    for number in (1, 2, 3):
        (tmp_path / f"runs/made/retrieval/m{number}/1/records.csv").unlink()
    with pytest.raises(UserError, match="3 faults") as error:
        built(tmp_path)
    assert str(error.value).count("no such file") == 3


def test_two_results_of_one_method(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 2)
    plain = write_method(tmp_path / "r", method("method 1", 0.5))
    with pytest.raises(UserError, match=r"two results of [mM]ethod 1"):
        built(tmp_path, results=[plain])


def test_two_teams_with_one_method_are_told_apart(tmp_path: Path) -> None:
    """Whoever runs SALAD calls it SALAD; were that a fault, anybody could stop the board."""
    for folder, rate in (("a", 0.4), ("b", 0.5), ("c", 0.6)):
        name = "Other" if folder == "c" else "SALAD"
        scored = method(name, rate, seed=ord(folder))
        write_version(tmp_path / "runs", folder, 1, scored, team=f"Team {folder}")
    site = built(tmp_path)
    table = (site / "downloads/made.csv").read_text(encoding="utf-8")
    assert ("SALAD (Team a)" in table, "SALAD (Team b)" in table) == (True, True)
    assert "Other (" not in table
    page = (site / "tables/made/compare.html").read_text(encoding="utf-8")
    assert "SALAD (Team a)" in page
    assert "Other (" not in page


def test_scores_that_mean_different_things(tmp_path: Path) -> None:
    one = method("A", 0.5)
    columns = [c.model_copy(update={"title": "Other"}) for c in one.result.columns]
    paths = [
        write_method(tmp_path / "a", one),
        write_method(tmp_path / "b", method("B", 0.5, columns=columns)),
    ]
    with pytest.raises(UserError, match="mean different things"):
        built(tmp_path, results=paths)


def test_other_queries_are_refused(tmp_path: Path) -> None:
    one, other = method("A", 0.5), method("B", 0.5)
    other.records.loc[0, "query"] = "east/other"
    paths = [write_method(tmp_path / n, m) for n, m in (("a", one), ("b", other))]
    with pytest.raises(UserError, match="not on the same queries"):
        built(tmp_path, results=paths)


@pytest.mark.parametrize("team", ["Team", "Others"])
def test_only_a_team_supersedes_its_own(tmp_path: Path, team: str) -> None:
    write_version(tmp_path / "runs", "a", 1, method("A", 0.5))
    write_version(tmp_path / "runs", "b", 1, method("B", 0.5), supersedes="a", team=team)
    faults = Faults()
    found = read_entries(tmp_path / "runs", faults)
    assert bool(faults.found) == (team == "Others")
    assert [entry.name for entry in found] == (["b"] if team == "Team" else ["a", "b"])


def test_a_circle_of_submissions_is_refused(tmp_path: Path) -> None:
    write_version(tmp_path / "runs", "a", 1, method("A", 0.5), supersedes="b")
    write_version(tmp_path / "runs", "b", 1, method("B", 0.5), supersedes="a")
    with pytest.raises(UserError, match="supersede each other"):
        built(tmp_path)


def test_what_waits_is_said(tmp_path: Path) -> None:
    write_version(tmp_path / "runs", "a", 1, method("A", 0.5))
    for name in ("a", "b"):
        folder = tmp_path / "submissions/made/retrieval" / name
        folder.mkdir(parents=True)
        (folder / "submission.toml").touch()
    entries = read_entries(tmp_path / "runs", Faults())
    assert waiting(tmp_path / "submissions", entries) == [
        "made/retrieval/b has not been scored yet: no row"
    ]


def sealed(runs: Path, folder: str, value: float | None, error: float | None) -> None:
    place = write_version(runs, folder, 1, method(folder, 0.5))
    (place / "result.json").unlink()
    (place / "records.csv").unlink()
    one = {"value": value, "standard_error": error}
    column = {
        "key": "recall@1", "title": "R@1", "unit": "share", "higher_is_better": True,
        "average": "mean", "headline": True,
    }  # fmt: skip
    answer = {
        "schema": 1, "sealed": True, "track": "retrieval", "protocol": "made",
        "protocol_version": 1, "protocol_fingerprint": "p" * 64, "benchmark": "made",
        "truth_commitment": "t" * 64, "method": folder, "predictions_sha256": "0" * 64,
        "columns": [column], "queries": {"a": 50}, "scene_titles": {"a": "A"},
        "scenes": {"a": {"recall@1": one}}, "overall": {"recall@1": one},
        "versions": {"airzoo-bench": "1"},
    }  # fmt: skip
    (place / "answer.json").write_text(json.dumps(answer), encoding="utf-8")


def test_sealed_answers_have_conservative_ranges_and_no_pairs(tmp_path: Path) -> None:
    for folder, value, error in (("a", 0.9, 0.02), ("b", 0.86, 0.02), ("c", 0.4, 0.03)):
        sealed(tmp_path / "runs", folder, value, error)
    site = built(tmp_path)
    table = json.loads((site / "api/v1/tables/made/table.json").read_text(encoding="utf-8"))
    assert table["sealed"]
    assert "sealed" in table["about_ranks"]
    assert [row["kind"] for row in table["rows"]] == ["sealed"] * 3
    ranks = [row["scores"]["recall@1"]["rank"] for row in table["rows"]]
    assert ranks == [[1, 2], [1, 2], [3, 3]]
    assert table["rows"][0]["scores"]["recall@1"]["standard_error"] == 0.02
    assert table["scores"][0]["pairs"] is None
    assert not (site / "api/v1/tables/made/pairs").exists()


LINK = '[[reproduction]]\nprotocol = "airzoo-mini-retrieval"\nmethod = "SALAD"\n'


def scenes_of(rows: list[Row]) -> dict[str, Any]:
    return {row.id: {"": row.scores, "city": row.scores} for row in rows}


def test_the_ledger_pairs_printed_and_scored_numbers(tmp_path: Path) -> None:
    own, printed = sample_row(0, 4, "re-scored"), sample_row(1, 4, "reported")
    path = tmp_path / "reproductions.toml"
    path.write_text(f'schema = 1\n{LINK}printed = "Method 1"\nwhy = "Weights."\n')
    links = read_links(path)
    table = sample_table("airzoo-mini-retrieval", [own, printed])
    found = find_reproductions(table, scenes_of([own, printed]), links, {})
    assert {(one.scene, one.score) for one in found} >= {("", "recall@1"), ("city", "ap@5")}
    first = next(one for one in found if (one.scene, one.score) == ("", "recall@1"))
    assert (first.printed_text, first.rescored_text) == ("72.50", "90.00")
    assert (first.within, first.by, first.why) == (False, "Team 0", "Weights.")


def test_the_same_name_is_the_same_method() -> None:
    own = sample_row(5, 9, "re-scored")
    printed = Row("reported-5", "reported", "Method 5", {"recall@1": Score(0.5, "50.00")})
    table = sample_table("airzoo-mini-retrieval", [own, printed])
    found = find_reproductions(table, {own.id: {}, printed.id: {}}, (), {})
    assert [(one.row, one.why) for one in found] == [(own.id, "")]


def test_nobody_takes_a_reproduction_s_place() -> None:
    rows = [
        Row(team, "re-scored", "SALAD", {"recall@1": Score(value, "")}, team=team)
        for team, value in (("Lab", 0.5), ("Spoiler", 0.01))
    ]
    printed = Row("reported-salad", "reported", "SALAD", {"recall@1": Score(0.5, "50.00")})
    table = sample_table("airzoo-mini-retrieval", [*rows, printed])
    found = find_reproductions(table, {row.id: {} for row in (*rows, printed)}, (), {})
    assert [one.by for one in found] == ["Lab", "Spoiler"]


@pytest.mark.parametrize(
    ("printed", "half", "within"),
    [(0.6004, 0.0005, True), (0.6006, 0.0005, False), (0.6004, 0.00005, False), (0.55, 0.0, True)],
)
def test_a_printed_number_stands_for_all_that_rounds_to_it(
    printed: float, half: float, within: bool
) -> None:
    own = Row("own", "re-scored", "Net", {"recall@1": Score(0.5, "50.00", 0.4, 0.6)})
    other = Row("reported", "reported", "Net", {"recall@1": Score(printed, "")})
    table = sample_table("airzoo-mini-retrieval", [own, other])
    halves = {("Net", "", "recall@1"): half}
    [one] = find_reproductions(table, {own.id: {}, other.id: {}}, (), halves)
    assert one.within is within


def test_half_a_digit_of_what_is_published(tmp_path: Path) -> None:
    reported = read_reported(tmp_path)
    seen, units = 0, {column.key: column.unit for column in COLUMNS}
    for table in reported.tables:
        titles = {title: title for scenes in table.values.values() for title in scenes if title}
        halves = reported.halves(table.benchmark, table.track, units, titles)
        seen += len(halves)
        assert all(half in {0.5 / 10**n for n in range(2, 6)} for half in halves.values())
    assert seen


@pytest.mark.parametrize("name", ["method", "printed"])
def test_a_link_to_nothing_is_refused(name: str) -> None:
    own, printed = sample_row(0, 4, "re-scored"), sample_row(1, 4, "reported")
    fields = {"method": "SALAD", "printed": "Method 1"} | {name: "SALAT"}
    link = Link.model_validate({"protocol": "airzoo-mini-retrieval"} | fields)
    table = sample_table("airzoo-mini-retrieval", [own, printed])
    with pytest.raises(UserError, match="no method 'SALAT'"):
        find_reproductions(table, scenes_of([own, printed]), [link], {})


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


def test_links_are_read_strictly(tmp_path: Path) -> None:
    path = tmp_path / "reproductions.toml"
    assert read_links(path) == ()
    path.write_text(f"schema = 1\n{LINK}becasue = 'x'\n")
    with pytest.raises(UserError, match="unknown key"):
        read_links(path)


def test_serving_a_built_site(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 1)
    site = built(tmp_path)
    (tmp_path / "secret").write_text("secret")
    (site / "link").symlink_to(tmp_path / "secret")
    places = [str(Path(__file__).parents[3]), *sys.path]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places)}
    serve = ["-m", "airzoo_bench", "leaderboard", "serve", str(site), "--port", "0"]
    with subprocess.Popen(
        [sys.executable, *serve],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.match(r"http://127\.0\.0\.1:\d+/", line)
        assert found, line
        address = found[0]
        with urllib.request.urlopen(f"{address}api/v1/board.json") as answer:
            assert json.load(answer)["title"] == "A board"
        with urllib.request.urlopen(address) as answer:
            assert b"A board" in answer.read()
        for path in ("../secret", "%2e%2e/secret", "link", "nothing", "api/"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(address + path)
        with pytest.raises(urllib.error.HTTPError, match="501"):
            urllib.request.urlopen(urllib.request.Request(address, b"x", method="PUT"))
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
    assert process.returncode == 0
    assert said == ""


def test_what_is_no_site_is_not_served(tmp_path: Path) -> None:
    from airzoo_bench.leaderboard.site.serving import serve_folder

    with pytest.raises(UserError, match="not the site of a board"):
        serve_folder(tmp_path, 0, print)


def test_a_protocol_that_nobody_knows(tmp_path: Path) -> None:
    board = given(tmp_path).board
    assert board is not None
    [one] = board.benchmarks
    unknown = one.model_copy(update={"protocols": ("nowhere",)})
    with pytest.raises(UserError, match="unknown protocol nowhere"):
        built(tmp_path, board=board.model_copy(update={"benchmarks": (unknown,)}))
