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

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import checks
from airzoo_bench.leaderboard import submission as rules
from airzoo_bench.leaderboard.board import BOARD_FILE, known_submissions, read_board
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, read_submission, skeleton
from tests.leaderboard import conftest as world
from tests.leaderboard.conftest import ADA, HOME, PROTOCOL
from tests.statistics.support import made_method
from tests.support import ROOT, write_predictions

Change = Callable[[Path], object]

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


@pytest.fixture
def root(tmp_path: Path, data: Path) -> Path:
    """Return a board to submit to."""
    (root := tmp_path / "board").mkdir()
    (root / BOARD_FILE).write_text(world.BOARD)
    return root


def check(root: Path, data: Path, folder: Path, seconds: float = 0.0) -> checks.CheckedSubmission:
    """Check a folder as the command line does."""
    known, board = known_submissions(root), read_board(root / BOARD_FILE)
    return checks.check_submission(folder, checks.Rules(board, root, data, Run()), known, seconds)


def _limit(root: Path, limits: str) -> None:
    (root / BOARD_FILE).write_text(world.BOARD.replace("[[", f"[limits]\n{limits}\n[[", 1))


def _change(home: Path, old: bytes, new: bytes, name: str = SUBMISSION_FILE) -> None:
    (home / name).write_bytes((home / name).read_bytes().replace(old, new))


def _move(home: Path, place: str) -> Path:
    return Path(shutil.copytree(home, home.parents[2] / place))


def _state(text: str) -> Change:
    return lambda home: (home / SUBMISSION_FILE).write_text(text)


TWO_PLACES = {"file": "p.npz", "url": "https://a.b/p", "sha256": "0" * 64, "bytes": 1}
# What a submission beside another states or what is done to its folder, and what is said.
ERRORS: list[tuple[str, dict[str, Any] | Change]] = [
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
    ("too large", _state("x" * 20_000)),
    ("not valid TOML", _state("method = " + "[" * 15_000)),
    ("key 'method'", _state("method" + ".a" * 4_000 + " = 1")),
    ("differs from 'SALAD' only in case", {"method": "Salad", "team": "Other"}),
    ("only in case", lambda home: _move(home, "made/retrieval/Salad")),
    ("a pipe or a device", lambda home: os.mkfifo(home / "pipe")),
    ("executable", lambda home: (home / "preds.npz").chmod(0o755)),
    ("'predictions.file'", lambda home: (home / "preds.npz").unlink()),
    (".sha256'", lambda home: _change(home, b"query_ids", b"query_idz", "preds.npz")),
    ("'predictions.bytes'", lambda home: _change(home, b"bytes = ", b"bytes = 1")),
    ("no such submission file", lambda home: (home / SUBMISSION_FILE).unlink()),
    ("which does not score", {"protocol": "uav-visloc-retrieval"}),
    *(
        ("which does not score", lambda home, at=at: _move(home, at))
        for at in ("mad/retrieval/new", "made/matching/new", "made/retrieval/nul")
    ),
    ("at most 1,000 bytes", lambda home: _limit(home.parents[3], "committed_bytes = 1000")),
]
NOTES: list[tuple[str, dict[str, Any] | Change]] = [
    ("looks like 'Example Lab'", {"team": "Example Iab"}),
    ("looks like 'SALAD'", {"method": "S-A-L-A-D"}),
    ("to the last byte those of 'SALAD'", {"team": "Other"}),
    ("is on this board already, of team 'Example", {"method": "SALAD", "team": "Other"}),
    ("says that it is official", {"team": "Other", "method": "Net (official)"}),
    ("'supersedes' is ignored", {"supersedes": "nothing"}),  # as earlier submissions have it
    ("'account' is missing", {"account": None}),
]


@pytest.mark.parametrize(("kind", "cases"), [("errors", ERRORS), ("warnings", NOTES)])
def test_mistakes_and_claims(kind: str, cases: Any, root: Path, data: Path, perfect: Any) -> None:
    for said, change in cases:
        (root / BOARD_FILE).write_text(world.BOARD)
        shutil.rmtree(root / "submissions", ignore_errors=True)
        world.write_submission(root, perfect)
        stated = {"method": "New"} | (change if isinstance(change, dict) else {})
        home = world.write_submission(root, perfect, "new", **stated)
        moved = None if isinstance(change, dict) else change(home)
        found = check(root, data, moved if isinstance(moved, Path) else home)
        [text] = [text for text in map(str, getattr(found, kind)) if said in text]
        assert text.replace("\n", "").isprintable()
        assert len(text) < 2_000
        assert len(found.errors) == (kind == "errors")


def test_predictions_are_fetched(root: Path, data: Path, perfect: Any, monkeypatch: Any) -> None:
    found = check(root, data, home := world.write_submission(root, perfect))
    assert (found.errors, found.warnings) == ([], [])
    assert found.predictions == home / "preds.npz"
    twice = {**perfect, "ranked_ids": [[row[0], *row[:-1]] for row in perfect["ranked_ids"]]}
    [error] = check(root, data, world.write_submission(root, twice, "other")).errors
    assert "each tile once a query" in str(error)

    def fetch(_: str, into: Path, **__: Any) -> Path:
        into.mkdir(parents=True)
        (into / ".preds.npz.part").touch()
        return Path(shutil.move(home / "preds.npz", into / "preds.npz"))

    monkeypatch.setattr(checks, "fetch", asked := mock.Mock(side_effect=fetch))
    _change(home, b'file = "preds.npz"', b'url = "https://example.org/preds.npz"')
    several = [check(root, data, home, seconds) for seconds in (0.0, 1.0, 0.0)]
    stated = several[0].sound.predictions
    kept = data / checks.FETCHED / stated.sha256
    assert [one.predictions for one in several] == [None, *[kept / "preds.npz"] * 2]
    promised = {"size": stated.size, "sha256": stated.sha256, "seconds": 1.0}
    assert asked.call_args_list == [mock.call(stated.url, kept, **promised)]
    _limit(root, "url_bytes = 100")
    for said in ("at most 100", "https://HOST/PATH"):  # which needs no network
        [error] = check(root, data, home).errors
        assert said in str(error)
        _change(home, b"https://example.org", b"https://169.254.169.254")


def test_poses_that_are_the_prior_belong_to_its_class() -> None:
    result = made_method({"east": {"recall@1": [1.0] * 10}}).result
    result = result.model_copy(update={"counts": {"east": {"queries": 10, "near_prior": 2}}})
    with pytest.raises(SubmissionError, match="2 of 10 poses"):
        checks.check_pipeline(world.submission(), result)
    pipeline = {"stages": "single-stage", "uses": ["prior"]}
    checks.check_pipeline(world.submission(pipeline=pipeline), result)


def test_submissions_of_this_repository_are_sound_and_small(tmp_path: Path) -> None:
    """Those on AirZoo-Mini are scored where it is made: tests/datasets/mini/test_prepare.py."""
    known = known_submissions(ROOT)
    assert {place.benchmark for place in known} >= {"airzoo-demo", "airzoo-mini"}
    assert not [place for place in known if check(ROOT, tmp_path, ROOT / place.path).errors]
    assert checks.size_of_tree(ROOT / "submissions") < 1_500_000


FOLDER = f"{HOME}/salad"


@pytest.fixture
def preds(tmp_path: Path, root: Path, perfect: Any, monkeypatch: Any) -> Path:
    """Return predictions; the current folder is that of a board."""
    monkeypatch.chdir(root)
    return write_predictions(tmp_path / "preds.npz", PROTOCOL, **perfect)


def test_wrong_options_write_nothing_and_only_force_replaces(root: Path, preds: Path) -> None:
    def refusal(*options: str) -> str:
        return str(world.run("submit", preds, *options, code=1).exception)

    whole, path = [*world.OPTIONS, "--no-commit"], root / FOLDER / SUBMISSION_FILE
    for said, options in {
        "--team, --contact, --author, --licence, --training-data, --stages": ("--method", "SALAD"),
        "did you mean 'made-retrieval'": [*whole, "--protocol", "made-retrieva"],
        "papr": [*whole, "--set", "papr=https://a.org"],
    }.items():
        assert said in refusal(*options)
        assert not (root / "submissions").exists()
    url = "https://example.org/preds.npz"
    world.run("submit", preds, *whole, "--url", url)
    assert [*(root / FOLDER).iterdir()] == [path]  # the file is not copied
    stated = read_submission(path).predictions
    assert (stated.url, stated.size) == (url, preds.stat().st_size)
    assert "--force" in refusal(*whole)
    assert f"account {ADA}" in refusal(*whole, "--force", "--set", "account=7")
    more = ("--force", "--set", "summary=Newer", "--set", 'pipeline.uses=["prior"]')
    world.run("submit", preds, *whole, *more)
    newer = read_submission(path)
    assert (newer.summary, newer.pipeline.uses) == ("Newer", ("prior",))


def test_nine_questions_at_most(root: Path, preds: Path, monkeypatch: Any) -> None:
    terminal, call = SimpleNamespace(isatty=lambda: True), ("submit", preds, "--no-commit")
    streams = SimpleNamespace(stdin=terminal, stderr=terminal)
    monkeypatch.setattr("airzoo_bench.leaderboard.submitting.sys", streams)
    monkeypatch.setattr("airzoo_bench.leaderboard.submitting.gh_account", lambda: None)
    who = ("SALAD", "Example Lab", "nobody", "ada@example.org", "Ada Example, Grace Example")
    made = world.run(*call, answers=(ADA, *who, "CC-BY-4.0", "none", "single-stage"))
    assert "'nobody'" in made.output  # asked again
    stated = read_submission(root / FOLDER / SUBMISSION_FILE)
    assert (stated.method, stated.account) == ("SALAD", ADA)
    assert stated.authors == ("Ada Example", "Grace Example")
    assert (stated.training_data, stated.pipeline.stages) == ((), "single-stage")
    # The folder is looked at before further questions.
    again = world.run(*call, answers=(ADA, "SALAD"), code=1)
    assert "--force" in str(again.exception)
