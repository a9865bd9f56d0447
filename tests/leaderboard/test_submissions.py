"""Submissions: names, submission.toml, the check of a folder, and ``airzoo-bench submit``."""

from __future__ import annotations

import json
import os
import shutil
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import confusable_homoglyphs
import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard import checks, submitting
from airzoo_bench.leaderboard import submission as rules
from airzoo_bench.leaderboard.board import BOARD_FILE, known_submissions, read_board
from airzoo_bench.leaderboard.submission import read_submission, skeleton
from tests.leaderboard import conftest as world
from tests.support import ROOT, write_predictions

TAKEN = ["π³", "MASt3R++", "Δ-Net", "Яндекс", "北京大学", "トヨタ", "삼성", "Łódź", "R&D"]
REFUSED = [
    *("SALAD\u202egnp", "SALAD\u3164", "SALAD\ufe0f", "\x1b[31mSALAD", "***", "www.example.org"),
    *("Ame\u0301lie", "q\u0327\u030a\u030b", " SALAD", "SA  LAD", "S\u0410LAD", "https://a.org"),
    *("=HYPERLINK(1)", "+1", "-1", "@a", "<b>S</b>", "`S`", "S|L", r"\input{x}", "javascript:x"),
]
ALIKE = ["SALAD Salad", "VGG16 VGGl6", "Cornet Comet", "Ame Amé", "Net² Net2"]
ALIKE += [f"SALAD S{mark}A'LAD{mark}." for mark in '-_·",:;()[]{}~!?']
APART = ["SALAD SALAD+", "v1.1 v11", "DUSt3R MASt3R", "π3 Pi3"]


def test_names_are_printable_of_one_script_and_found_where_they_look_alike() -> None:
    assert [rules.check_name(name) for name in TAKEN] == TAKEN
    for name in REFUSED:
        with pytest.raises(ValueError, match=r"^(has|is)"):
            rules.check_name(name)
    for pair in ALIKE + APART:
        one, other = map(skeleton, pair.split())
        assert (one == other) == (pair in ALIKE), pair


def test_unicodes_lookalikes_of_ascii_are_refused_or_have_its_skeleton() -> None:
    path, taken = Path(confusable_homoglyphs.__file__).with_name("confusables.json"), []
    for letter, others in json.loads(path.read_text(encoding="utf-8")).items():
        plain = [one["c"] for one in others if one["c"].isascii() and one["c"].isalnum()]
        with suppress(ValueError):
            found = skeleton(rules.check_name(f"1{letter}"))
            assert {skeleton(f"1{one}") for one in plain} <= {found}, letter
            taken += plain
    assert len(taken) > 50


@pytest.fixture
def root(tmp_path: Path, data: Path, perfect: Any, monkeypatch: Any) -> Path:
    """Return a board to submit to, which is the current folder, with predictions in it."""
    (tmp_path / BOARD_FILE).write_text(world.BOARD)
    write_predictions(tmp_path / "preds.npz", world.PROTOCOL, **perfect)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def check(root: Path, data: Path, folder: Path, seconds: float = 0.0) -> checks.CheckedSubmission:
    """Check a folder as the command line does."""
    known, board = known_submissions(root), read_board(root / BOARD_FILE)
    return checks.check_submission(
        folder, checks.Rules(board, root, data, checks.Run()), known, seconds
    )


FILE, URL = {"sha256": "0" * 64, "bytes": 1}, {"url": "https://example.org/p"}
# What is said, and the keys or the folder of another submission.
ERRORS: list[tuple[str, dict[str, Any]]] = [
    ("key 'contact' is missing", {"contact": None}),
    ("'contact' is 'Ada'", {"contact": "Ada"}),
    ("'paper' is 'http://example.org'", {"paper": "http://example.org"}),
    ("'code'", {"code": "https://github.com@evil.example/"}),
    ("'predictions': either", {"predictions": FILE}),
    ("'predictions': either", {"predictions": FILE | URL | {"file": "preds.npz"}}),
    ("'predictions.bytes'", {"predictions": FILE | {"file": "preds.npz"}}),
    ("'predictions.file'", {"predictions": FILE | {"file": "pred.npz"}}),
    ("https://HOST/PATH", {"predictions": FILE | {"url": "https://169.254.169.254/p"}}),
    ("at most 20,000,000,000", {"predictions": FILE | URL | {"bytes": 1 << 40}}),
    ("'team' is '\\x1b[2Jlab'", {"team": "\x1b[2Jlab"}),
    ("too large", {"summary": "x" * 20_000}),
    ("method 'Salad' differs from 'SALAD' only in case", {"method": "Salad", "team": "Other"}),
    ("folder 'Salad' differs from 'salad' only in case", {"folder": "Salad"}),
    ("which does not score", {"protocol": "uav-visloc-retrieval"}),
    ("which does not score", {"folder": "../../mad/retrieval/new"}),
    ("which does not score", {"folder": "../matching/new"}),
    ("which does not score", {"folder": "nul"}),
]
WARNINGS: list[tuple[str, dict[str, Any]]] = [
    ("looks like 'Example Lab'", {"team": "Example Iab"}),
    ("looks like 'SALAD'", {"method": "S-A-L-A-D"}),
    ("to the last byte those of 'SALAD'", {"team": "Other"}),
    ("is on this board already, of team 'Example", {"method": "SALAD", "team": "Other"}),
    ("says that it is official", {"team": "Other", "method": "Net (official)"}),
    ("'supersedes' is ignored", {"supersedes": "nothing"}),  # as earlier submissions have it
    ("'account' is missing", {"account": None}),
]


@pytest.mark.parametrize(("kind", "cases"), [("errors", ERRORS), ("warnings", WARNINGS)])
def test_mistakes_and_claims(kind: str, cases: Any, root: Path, data: Path, perfect: Any) -> None:
    for said, change in cases:
        shutil.rmtree(root / "submissions", ignore_errors=True)
        world.write_submission(root, perfect)
        keys = {"method": "New", "folder": "new"} | change
        found = check(root, data, world.write_submission(root, perfect, **keys))
        [text] = [text for text in map(str, getattr(found, kind)) if said in text]
        assert text.replace("\n", "").isprintable()
        assert len(text) < 2_000
        assert len(found.errors) == (kind == "errors")


def test_predictions_are_fetched_and_sound(root: Path, data: Path, perfect: Any) -> None:
    found = check(root, data, home := world.write_submission(root, perfect))
    assert (found.errors, found.warnings, found.predictions) == ([], [], home / "preds.npz")
    stated = found.sound.predictions
    facts = URL | {"sha256": stated.sha256, "bytes": stated.size}
    home = world.write_submission(root, perfect, "fetched", method="New", predictions=facts)
    assert check(root, data, home).predictions is None
    (kept := data / checks.FETCHED / stated.sha256).mkdir(parents=True)
    (kept / ".preds.npz.part").touch()
    shutil.move(home / "preds.npz", file := kept / "preds.npz")
    with mock.patch.object(checks, "fetch", return_value=file) as fetch:
        assert [check(root, data, home, s).predictions for s in (0.0, 1.0)] == [file, file]
    promised = {"size": stated.size, "sha256": stated.sha256, "seconds": 1.0}
    fetch.assert_called_once_with(URL["url"], kept, **promised)
    file.write_bytes(bytes(stated.size))
    twice = {**perfect, "ranked_ids": [[row[0], *row[:-1]] for row in perfect["ranked_ids"]]}
    other, pipe = (world.write_submission(root, twice, name) for name in ("other", "pipe"))
    os.mkfifo(pipe / "pipe")
    faults = {"'predictions.sha256'": home, "each tile once": other, "a pipe or a device": pipe}
    for said, folder in faults.items():
        [error] = check(root, data, folder).errors
        assert said in str(error)


def test_poses_that_are_the_prior_belong_to_its_class() -> None:
    result: Any = SimpleNamespace(counts={"east": {"queries": 10, "near_prior": 2}})
    with pytest.raises(SubmissionError, match="2 of 10 poses"):
        checks.check_pipeline(world.submission(), result)
    pipeline = {"stages": "single-stage", "uses": ["prior"]}
    checks.check_pipeline(world.submission(pipeline=pipeline), result)
    result.counts["east"] = {"queries": 100, "near_prior": 1}  # so many may be by chance
    checks.check_pipeline(world.submission(), result)


def test_submissions_of_this_repository_are_sound_and_small(tmp_path: Path) -> None:
    """Those on AirZoo-Mini are scored where it is made: tests/datasets/mini/test_prepare.py."""
    known = known_submissions(ROOT)
    assert {place.benchmark for place in known} >= {"airzoo-demo", "airzoo-mini"}
    assert not [place for place in known if check(ROOT, tmp_path, ROOT / place.path).errors]
    assert checks.size_of_tree(ROOT / "submissions") < 1_500_000


def test_submit_asks_nine_questions_and_only_force_replaces(root: Path, monkeypatch: Any) -> None:
    def submit(*options: str, refused: bool = True, answers: Any = ()) -> str:
        line = ("submit", "preds.npz", "--no-commit", *options)
        done = world.run(*line, code=refused, answers=answers)
        return str(done.exception) if refused else done.output

    assert "--author, --licence, --training-data, --stages" in submit("--method", "SALAD")
    assert "did you mean 'made-retrieval'" in submit(*world.OPTIONS, "--protocol", "made-retrieva")
    assert "papr" in submit(*world.OPTIONS, "--set", "papr=https://a.org")
    assert not (root / "submissions").exists()
    submit(*world.OPTIONS, "--url", URL["url"], refused=False)
    [path] = (root / world.HOME / "salad").iterdir()  # the file is not copied
    stated = read_submission(path).predictions
    assert (stated.url, stated.size) == (URL["url"], Path("preds.npz").stat().st_size)
    assert f"account {world.ADA}" in submit(*world.OPTIONS, "--force", "--set", "account=7")
    more = ("--force", "--set", "summary=Newer", "--set", 'pipeline.uses=["prior"]')
    submit(*world.OPTIONS, *more, refused=False)
    newer = read_submission(path)
    assert (newer.summary, newer.pipeline.uses) == ("Newer", ("prior",))

    tty = SimpleNamespace(isatty=lambda: True)
    monkeypatch.setattr(submitting, "sys", SimpleNamespace(stdin=tty, stderr=tty))
    monkeypatch.setattr(submitting, "gh_account", lambda: None)
    assert "--force" in submit(answers=(world.ADA, "SALAD"))  # before further questions
    who = ("Net", "Example Lab", "nobody", "ada@example.org", "Ada Example, Grace Example")
    answers = (world.ADA, *who, "CC-BY-4.0", "none", "single-stage")
    assert "'nobody'" in submit(refused=False, answers=answers)  # asked again
    stated = read_submission(root / world.HOME / "net/submission.toml")
    assert (stated.method, stated.account, stated.training_data) == ("Net", world.ADA, ())
    assert stated.authors == ("Ada Example", "Grace Example")
