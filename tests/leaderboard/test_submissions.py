"""Submissions: names, submission.toml, the check of a folder, and ``airzoo-bench submit``."""

from __future__ import annotations

import json
import os
import shutil
import unicodedata
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import confusable_homoglyphs
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from airzoo_bench.cli.main import app
from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import checks
from airzoo_bench.leaderboard import submission as rules
from airzoo_bench.leaderboard.board import BOARD_FILE, known_submissions, read_board
from airzoo_bench.leaderboard.submission import read_submission, skeleton
from tests.leaderboard import conftest as world
from tests.leaderboard.conftest import ADA, HOME, PROTOCOL, Board
from tests.statistics.support import made_method
from tests.support import write_predictions

CHECKOUT = Path(__file__).resolve().parents[2]

# --- names ---

TAKEN = [
    *("SALAD", "π³", "MASt3R++", "DINOv2-B", "Δ-Net", "Яндекс", "北京大学", "トヨタ", "삼성"),
    *("Łódź", "R&D"),
]
REFUSED = [
    *("S\u0410LAD", "SALAD\u202egnp", "SAL\u200bAD", "SALAD\u3164", "SALAD\ufe0f", "\x1b[31mSALAD"),
    *("SALAD\n@maintainers", "=HYPERLINK(1)", "+1", "-1", "@team", "<b>SALAD</b>", "`SALAD`"),
    *("SA|LAD", r"\input{x}", "https://example.org", "www.example.org", "javascript:x"),
    *("Ame\u0301lie", "q\u0327\u030a\u030b", " SALAD", "SA  LAD", "\U0001d412ALAD", "\ua4e2\ua4ee"),
    *("\uff33ALAD", "***"),
]


ALIKE = [
    *("SALAD Salad", "SALAD SA-LAD", "SALAD SALAD.", 'SALAD "SALAD"', "SALAD (SALAD)"),
    *("SALAD SALAD,", "SALAD SALAD~", "VGG16 VGGl6", "Cornet Comet", "LoFTR L0FTR", "Ame Amé"),
    *("СОСА COCA", "ΑΒΕΖ ABEZ", "Net² Net2"),
]
APART = ["SALAD SALAD+", "v1.1 v11", "DUSt3R MASt3R", "π3 Pi3"]


def test_names_are_printable_of_one_script_and_found_where_they_look_alike() -> None:
    assert [rules.check_name(name) for name in TAKEN] == TAKEN
    for name in REFUSED:
        with pytest.raises(ValueError, match=r"^(has|is)"):
            rules.check_name(name)
    for pair in ALIKE + APART:
        one, other = pair.split()
        assert (skeleton(one) == skeleton(other)) == (pair in ALIKE), pair


def test_unicodes_lookalikes_of_ascii_are_refused_or_have_its_skeleton() -> None:
    place = Path(confusable_homoglyphs.__file__).parent / "confusables.json"
    pairs = [
        (letter, other["c"])
        for letter, others in json.loads(place.read_text(encoding="utf-8")).items()
        if len(letter) == 1 and ord(letter) > 127 and unicodedata.name(letter, "")
        for other in others
        if other["c"].isascii() and other["c"].isalnum()
    ]
    taken = set()
    assert len(pairs) > 1000
    for before in ("", "Net"):
        for letter, plain in pairs:
            with suppress(ValueError):
                taken.add(rules.check_name(before + letter))
                assert skeleton(before + letter) == skeleton(before + plain), (letter, plain)
    assert len(taken) > 10


@given(st.text(max_size=40))
def test_any_text_is_taken_or_refused_and_what_is_shown_is_harmless(text: str) -> None:
    for rule in (rules.check_line, rules.check_shown_line, rules.check_name):
        try:
            taken = rule(text)
        except ValueError as error:
            taken = str(error)  # shown as well
        assert taken.isprintable()
        assert not any(unicodedata.bidirectional(c) in ("RLO", "LRO", "RLE", "LRE") for c in taken)


# --- submission.toml ---


def only_error(found: checks.CheckedSubmission) -> str:
    [error] = found.errors
    return str(error)


TWO_PLACES = {"file": "p.npz", "url": "https://a.b/p", "sha256": "0" * 64, "bytes": 1}
WRONG: list[tuple[str, dict[str, Any] | str]] = [
    ("key 'contact' is missing", {"contact": None}),
    ("'training_data' is missing", {"training_data": None}),
    ("'methd' (did you mean 'method'?)", {"methd": "SALAD"}),
    ("'method' is 3", {"method": 3}),
    ("'date' is '2026-11-22'", {"date": "2026-11-22"}),
    ("'contact' is 'Ada'", {"contact": "Ada"}),
    ("'paper' is 'http://example.org'", {"paper": "http://example.org"}),
    ("'code'", {"code": "https://github.com@evil.example/"}),
    ("'weights'", {"weights": "javascript:x"}),
    ("'pipeline.stages' is 'two'", {"pipeline": {"stages": "two"}}),
    ("'predictions': either", {"predictions": TWO_PLACES}),
    ("'predictions': either", {"predictions": {"sha256": "0" * 64, "bytes": 1}}),
    ("'team' is '\\x1b[2Jlab'", {"team": "\x1b[2Jlab"}),
    ("too large", "x" * 50_000_000),
    ("not valid TOML", "method = " + "[" * 15_000),
    ("key 'method'", "method" + ".a" * 4_000 + " = 1"),
]


def test_each_mistake_is_named(tmp_path: Path) -> None:
    path = tmp_path / "submission.toml"
    for said, changes in WRONG:
        given = tomli_w.dumps(world.values(**changes)) if isinstance(changes, dict) else changes
        path.write_text(given)
        with pytest.raises(SubmissionError) as caught:
            read_submission(path)
        message = str(caught.value)
        assert said in message
        assert message.replace("\n", "").isprintable()
        assert len(message) < 2_000


# --- the check of a folder ---


@pytest.fixture
def root(tmp_path: Path, data: Path) -> Path:
    """Return a board to submit to."""
    (tmp_path / "board").mkdir()
    (tmp_path / "board" / BOARD_FILE).write_text(world.BOARD)
    return tmp_path / "board"


def write_limits(root: Path, limits: str) -> None:
    """Give a board limits."""
    (root / BOARD_FILE).write_text(world.BOARD.replace("[[", f"[limits]\n{limits}\n[[", 1))


def _change(home: Path, old: bytes, new: bytes, name: str = "submission.toml") -> None:
    (home / name).write_bytes((home / name).read_bytes().replace(old, new))


def _move(home: Path, place: str) -> Path:
    return Path(shutil.copytree(home, home.parents[2] / place))


# What is done to a sound folder, and what is said.
FAULTS: list[tuple[Callable[[Path], object], str]] = [
    (lambda home: os.mkfifo(home / "pipe"), "a pipe or a device"),
    (lambda home: (home / "preds.npz").chmod(0o755), "executable"),
    (lambda home: (home / "preds.npz").unlink(), "'predictions.file'"),
    (lambda home: _change(home, b"query_ids", b"query_idz", "preds.npz"), ".sha256'"),
    (lambda home: _change(home, b"bytes = ", b"bytes = 1"), "'predictions.bytes'"),
    (lambda home: (home / "submission.toml").unlink(), "no such submission file"),
    (lambda home: _move(home, "mad/retrieval/salad"), "which does not score"),
    (lambda home: _move(home, "made/matching/salad"), "which does not score"),
    (lambda home: _move(home, "made/retrieval/nul"), "which does not score"),
    (lambda home: _change(home, b"made-retr", b"uav-visloc-retr"), "which does not score"),
    (lambda home: write_limits(home.parents[3], "committed_bytes = 1000"), "at most 1,000 bytes"),
]


def test_folders_that_ci_refuses(root: Path, data: Path, perfect: Any) -> None:
    found = world.checked(home := world.write_submission(root, perfect), data)
    assert (found.errors, found.warnings) == ([], [])
    assert found.predictions == home / "preds.npz"
    twice = {name: [[row[0], *row[:-1]] for row in rows] for name, rows in perfect.items()}
    other = world.write_submission(root, perfect | {"ranked_ids": twice["ranked_ids"]}, "other")
    assert "each tile once a query" in only_error(world.checked(other, data))
    for change, said in FAULTS:
        shutil.rmtree(root / "submissions")
        moved = change(home := world.write_submission(root, perfect))
        assert said in only_error(world.checked(moved if isinstance(moved, Path) else home, data))


def test_predictions_at_an_address_are_fetched_where_that_is_asked_and_kept(
    root: Path, data: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = write_predictions(root / "preds.npz", PROTOCOL, **perfect)
    stated = {"bytes": file.stat().st_size, "sha256": sha256_of_tree(file)}

    def fetch(_: str, into: Path, **__: Any) -> Path:
        into.mkdir(parents=True)
        (into / ".preds.npz.part").touch()
        return Path(shutil.copy(file, into))

    def by_address(url: str) -> Path:
        home = world.write_submission(root, perfect, predictions={"url": url} | stated)
        (home / "preds.npz").unlink()
        return home

    monkeypatch.setattr(checks, "fetch", asked := mock.Mock(side_effect=fetch))
    home = by_address("https://example.org/preds.npz")
    places = [world.checked(home, data, seconds).predictions for seconds in (0.0, 1.0, 0.0)]
    assert places == [None, *[data / checks.FETCHED / str(stated["sha256"]) / "preds.npz"] * 2]
    [call] = asked.call_args_list
    assert call.args[0] == "https://example.org/preds.npz"
    assert (call.kwargs["size"], call.kwargs["sha256"]) == (*stated.values(),)
    write_limits(root, "url_bytes = 100")
    assert "at most 100" in only_error(world.checked(home, data))
    shutil.rmtree(home)  # an address that is never fetched is refused before
    home = by_address("https://169.254.169.254/preds.npz")
    assert "https://HOST/PATH" in only_error(world.checked(home, data))


CLAIMS: list[tuple[str, dict[str, Any], str]] = [
    ("error", {"method": "Salad", "team": "Other"}, "differs from 'SALAD' only in case"),
    ("error", {"folder": "Salad", "method": "New", "team": "Other"}, "only in case"),
    ("note", {"method": "New", "team": "Example Iab"}, "looks like 'Example Lab'"),
    ("note", {"method": "S-A-L-A-D"}, "looks like 'SALAD'"),
    ("note", {"method": "Mine", "team": "Other"}, "to the last byte those of 'SALAD'"),
    ("note", {"team": "Other"}, "'SALAD' is on this board already, of team 'Example Lab'"),
    ("note", {"team": "Other", "method": "Net (official)"}, "says that it is official"),
    ("note", {"method": "Newer"}, "'supersedes' is ignored"),
    ("note", {"method": "Newer", "account": None}, "'account' is missing"),
]


def test_names_and_predictions_that_are_there_already(root: Path, data: Path, perfect: Any) -> None:
    world.write_submission(root, perfect)
    for kind, changes, said in CLAIMS:
        home = world.write_submission(root, perfect, **({"folder": "second"} | changes))
        if "supersedes" in said:  # as earlier submissions have it
            _change(home, b"schema", b'supersedes = "nothing"\nschema')
        found = world.checked(home, data)
        assert any(said in str(one) for one in (found.errors, found.warnings)[kind == "note"])
        assert bool(found.errors) == (kind == "error")
        shutil.rmtree(home)


def test_poses_that_are_the_prior_belong_to_its_class() -> None:
    result = made_method({"east": {"recall@1": [1.0] * 10}}).result
    result = result.model_copy(update={"counts": {"east": {"queries": 10, "near_prior": 2}}})
    with pytest.raises(SubmissionError, match="2 of 10 poses"):
        checks.check_pipeline(world.submission(), result)
    pipeline = {"stages": "single-stage", "uses": ["prior"]}
    checks.check_pipeline(world.submission(pipeline=pipeline), result)


def test_submissions_of_this_repository_are_sound_and_small(tmp_path: Path) -> None:
    """Those on AirZoo-Mini are scored where it is made: tests/datasets/mini/test_prepare.py."""
    rules = checks.Rules(read_board(CHECKOUT / BOARD_FILE), CHECKOUT, tmp_path, Run())
    known = known_submissions(CHECKOUT)
    assert {place.benchmark for place in known} >= {"airzoo-demo", "airzoo-mini"}
    for place in known:
        assert not checks.check_submission(CHECKOUT / place.path, rules, known).errors
    assert checks.size_of_tree(CHECKOUT / "submissions") < 1_500_000


# --- submit ---

OPTIONS = ["--method", "SALAD", *world.OPTIONS, "--set", f"account={ADA}"]
FOLDER = f"{HOME}/salad"


@pytest.fixture
def preds(tmp_path: Path, root: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return predictions; the current folder is that of a board."""
    monkeypatch.chdir(root)
    return write_predictions(tmp_path / "preds.npz", PROTOCOL, **perfect)


def test_one_command_makes_a_branch_with_the_checked_folder(board: Board, preds: Path) -> None:
    fork = board.clone("ada")
    more = ("--board", fork, "--set", 'pipeline.uses=["prior"]', "--set", "code=https://a.org/b")
    for name in ("vinegar", "salad"):  # the second begins at the board's branch too
        made = world.run("submit", preds, *OPTIONS, *more, "--method", name)
        branch = f"submit-made-retrieval-{name}"
        steps = [f"git push --force -u origin {branch}", "gh pr create --fill"]
        assert made.stdout.splitlines()[-2:] == steps
        changed = world.git(fork, "diff", "--name-only", "main", branch).splitlines()
        assert changed == [f"{HOME}/{name}/{file}" for file in ("preds.npz", "submission.toml")]
    stated = read_submission(fork / FOLDER / "submission.toml")
    assert (stated.protocol, stated.account, stated.pipeline.uses) == (PROTOCOL, ADA, ("prior",))


def test_wrong_options_write_nothing_and_a_version_is_replaced_only_by_force(
    root: Path, preds: Path
) -> None:
    whole = [*OPTIONS, "--no-commit"]
    for options, said in (
        (OPTIONS[:2], "--team, --contact, --author, --licence, --training-data, --stages"),
        ([*whole, "--protocol", "made-retrieva"], "did you mean 'made-retrieval'"),
        ([*whole, "--set", "papr=https://a.org"], "papr"),
    ):
        assert said in str(world.run("submit", preds, *options, code=1).exception)
        assert not (root / "submissions").exists()
    world.run(
        "submit", preds, *whole, "--url", "https://example.org/preds.npz"
    )  # which is not copied
    [path] = (root / FOLDER).iterdir()
    stated = read_submission(path).predictions
    assert (stated.url, stated.size) == ("https://example.org/preds.npz", preds.stat().st_size)
    assert "--force" in str(world.run("submit", preds, *whole, code=1).exception)
    theirs = (*whole, "--force", "--set", "account=7")
    assert f"account {ADA}" in str(world.run("submit", preds, *theirs, code=1).exception)
    world.run("submit", preds, *whole, "--force", "--set", "summary=Newer")
    assert read_submission(path).summary == "Newer"


def test_nine_questions_at_most_on_a_terminal(
    root: Path, preds: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = SimpleNamespace(isatty=lambda: True)
    streams = SimpleNamespace(stdin=terminal, stderr=terminal)
    monkeypatch.setattr("airzoo_bench.leaderboard.submitting.sys", streams)
    monkeypatch.setattr("airzoo_bench.leaderboard.submitting.gh_account", lambda: None)
    given = ("SALAD", "Example Lab", "nobody", "ada@example.org", "Ada Example, Grace Example")
    answers = "\n".join(("1001", *given, "CC-BY-4.0", "none", "single-stage", ""))
    made = CliRunner().invoke(app, ["submit", str(preds), "--no-commit"], input=answers)
    assert made.exit_code == 0, made.output
    assert "'nobody'" in made.output  # asked again
    stated = read_submission(root / FOLDER / "submission.toml")
    assert (stated.method, stated.authors) == ("SALAD", ("Ada Example", "Grace Example"))
    assert (stated.training_data, stated.pipeline.stages) == ((), "single-stage")
    assert stated.account == ADA
    # The folder is looked at before further questions.
    again = CliRunner().invoke(app, ["submit", str(preds), "--no-commit"], input="1001\nSALAD\n")
    assert "--force" in str(again.exception)
