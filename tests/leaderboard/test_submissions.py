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

import confusable_homoglyphs
import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from airzoo_bench.cli.main import app
from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.leaderboard import checks
from airzoo_bench.leaderboard import submission as rules
from airzoo_bench.leaderboard.board import BOARD_FILE, known_submissions, read_board
from airzoo_bench.leaderboard.submission import read_submission, skeleton, submission_text
from tests.leaderboard.conftest import (
    ADA,
    AUTHOR,
    BOARD,
    HOME,
    PROTOCOL,
    checked,
    git,
    run,
    submission,
    values,
    write_submission,
)
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


def test_names_are_printable_and_of_one_script() -> None:
    assert [rules.check_name(name) for name in TAKEN] == TAKEN
    for name in REFUSED:
        with pytest.raises(ValueError, match=r"^(has|is)"):
            rules.check_name(name)


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        *(("SALAD", other, True) for other in ("Salad", "SA-LAD", "SALAD.", '"SALAD"', "(SALAD)")),
        *(("SALAD", other, True) for other in ("SALAD,", "SALAD~")),
        *(("VGG16", "VGGl6", True), ("Cornet", "Comet", True), ("LoFTR", "L0FTR", True)),
        *(("Ame", "Amé", True), ("СОСА", "COCA", True), ("ΑΒΕΖ", "ABEZ", True)),
        ("Net²", "Net2", True),
        *(("SALAD", "SALAD+", False), ("v1.1", "v11", False), ("DUSt3R", "MASt3R", False)),
        ("π3", "Pi3", False),
    ],
)
def test_names_that_look_alike_are_found(one: str, other: str, alike: bool) -> None:
    assert (skeleton(one) == skeleton(other)) == alike


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


def test_what_is_written_is_read_again_and_a_board_keeps_no_contact(tmp_path: Path) -> None:
    path, stated = tmp_path / "a.toml", submission(summary="A sentence.")
    path.write_text(submission_text(stated), encoding="utf-8")
    assert read_submission(path) == stated
    path.write_text(text := submission_text(stated, public=True), encoding="utf-8")
    assert "contact" not in text
    assert "ada@example.org" not in text
    assert read_submission(path, public=True) == stated.model_copy(update={"contact": None})


TWO_PLACES = {"file": "p.npz", "url": "https://a.b/p", "sha256": "0" * 64, "bytes": 1}
WRONG: dict[str, dict[str, Any] | str] = {
    "key 'contact' is missing": {"contact": None},
    "'training_data' is missing": {"training_data": None},
    "'methd' (did you mean 'method'?)": {"methd": "SALAD"},
    "'method' is 3": {"method": 3},
    "'date' is '2026-11-22'": {"date": "2026-11-22"},
    "'contact' is 'Ada'": {"contact": "Ada"},
    "'paper' is 'http://example.org'": {"paper": "http://example.org"},
    "'code'": {"code": "https://github.com@evil.example/"},
    "'weights'": {"weights": "javascript:x"},
    "'pipeline.stages' is 'two'": {"pipeline": {"stages": "two"}},
    "'predictions': either": {"predictions": TWO_PLACES},
    "'team' is '\\x1b[2Jlab'": {"team": "\x1b[2Jlab"},
    "too large": "x" * 50_000_000,
    "not valid TOML": "method = " + "[" * 15_000,
    "key 'method'": "method" + ".a" * 4_000 + " = 1",
}


@pytest.mark.parametrize("said", WRONG)
def test_each_mistake_is_named(said: str, tmp_path: Path) -> None:
    changes, path = WRONG[said], tmp_path / "submission.toml"
    path.write_text(changes if isinstance(changes, str) else tomli_w.dumps(values(**changes)))
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
    (tmp_path / "board" / BOARD_FILE).write_text(BOARD)
    return tmp_path / "board"


def write_limits(root: Path, limits: str) -> None:
    """Give a board limits."""
    (root / BOARD_FILE).write_text(BOARD.replace("[[", f"[limits]\n{limits}\n[[", 1))


def _change(home: Path, content: Callable[[bytes], bytes]) -> None:
    (home / "preds.npz").write_bytes(content((home / "preds.npz").read_bytes()))


def _name(home: Path, protocol: str) -> None:
    toml = home / "submission.toml"
    toml.write_text(toml.read_text().replace(PROTOCOL, protocol))


def _move(home: Path, place: str) -> Path:
    moved = home.parents[2] / place
    moved.parent.mkdir(parents=True, exist_ok=True)
    return Path(shutil.move(home, moved))


def _repeat(home: Path) -> None:
    """Answer with one tile twice, in a file that is announced as it is."""
    with np.load(home / "preds.npz") as stored:
        arrays = dict(stored)
    arrays["ranked_ids"][0][1] = arrays["ranked_ids"][0][0]
    shutil.rmtree(home)
    arrays.pop("protocol")
    write_submission(home.parents[3], arrays)


# What is done to a sound folder, and what is said.
FAULTS: list[tuple[Callable[[Path], object], str]] = [
    (lambda home: None, ""),
    (lambda home: (home / "link").symlink_to("/etc/passwd"), "is no file: a link"),
    (lambda home: os.mkfifo(home / "pipe"), "a pipe or a device"),
    (lambda home: (home / "preds.npz").chmod(0o755), "executable"),
    (lambda home: (home / "preds.npz").unlink(), "'predictions.file'"),
    (lambda home: _change(home, lambda c: c[:-1] + bytes([c[-1] ^ 1])), ".sha256'"),
    (lambda home: _change(home, lambda c: c + b"x"), "'predictions.bytes'"),
    (lambda home: (home / "submission.toml").unlink(), "no such submission file"),
    (lambda home: _move(home, "mad/retrieval/salad"), "which does not score"),
    (lambda home: _move(home, "made/matching/salad"), "which does not score"),
    (lambda home: _move(home, "made/retrieval/nul"), "which does not score"),
    (lambda home: _name(home, "uav-visloc-retrieval"), "which does not score"),
    (lambda home: _name(home, "own.toml"), "which does not score"),
    (_repeat, "each tile once a query"),
    (lambda home: write_limits(home.parents[3], "committed_bytes = 1000"), "at most 1,000 bytes"),
]


def test_folders_that_ci_refuses(root: Path, data: Path, perfect: Any) -> None:
    for change, said in FAULTS:
        moved = change(home := write_submission(root, perfect))
        found = checked(moved if isinstance(moved, Path) else home, data)
        if said:
            assert said in only_error(found)
        else:
            assert (found.errors, found.warnings) == ([], [])
            assert found.predictions == home / "preds.npz"
        shutil.rmtree(root / "submissions")


def test_predictions_at_an_address_are_fetched_where_that_is_asked_and_kept(
    root: Path, data: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, asked = write_predictions(root / "preds.npz", PROTOCOL, **perfect), []
    stated = {"bytes": file.stat().st_size, "sha256": sha256_of_tree(file)}

    def fetch(url: str, into: Path, *, size: int, sha256: str, seconds: float) -> Path:
        asked.append((url, size, sha256))
        into.mkdir(parents=True)
        (into / ".preds.npz.part").touch()
        return Path(shutil.copy(file, into))

    def by_address(url: str) -> Path:
        home = write_submission(root, perfect, predictions={"url": url} | stated)
        (home / "preds.npz").unlink()
        return home

    monkeypatch.setattr("airzoo_bench.leaderboard.checks.fetch", fetch)
    home = by_address("https://example.org/preds.npz")
    assert checked(home, data).predictions is None
    for seconds in (1.0, 0.0):
        found = checked(home, data, seconds)
        assert not found.errors
        assert found.predictions is not None
        assert found.predictions.is_relative_to(data / checks.FETCHED)
    assert asked == [("https://example.org/preds.npz", stated["bytes"], stated["sha256"])]
    write_limits(root, "url_bytes = 100")
    assert "at most 100" in only_error(checked(home, data))
    shutil.rmtree(home)  # an address that is never fetched is refused before
    home = by_address("https://169.254.169.254/preds.npz")
    assert "https://HOST/PATH" in only_error(checked(home, data))


CLAIMS: list[tuple[str, dict[str, Any], str]] = [
    ("error", {"method": "Salad", "team": "Other"}, "differs from 'SALAD' only in case"),
    ("error", {"folder": "Salad", "method": "New", "team": "Other"}, "only in case"),
    ("note", {"method": "New", "team": "Example Iab"}, "looks like 'Example Lab'"),
    ("note", {"method": "S-A-L-A-D"}, "looks like 'SALAD'"),
    ("note", {"method": "Mine", "team": "Other"}, "to the last byte those of 'SALAD'"),
    ("note", {"team": "Other"}, "'SALAD' is on this board already, of team 'Example Lab'"),
    ("note", {"team": "Other", "method": "Net (official)"}, "says that it is official"),
    ("note", {"supersedes": "nothing", "method": "Newer"}, "'supersedes' is ignored"),
]


def test_names_and_predictions_that_are_there_already(root: Path, data: Path, perfect: Any) -> None:
    write_submission(root, perfect)
    for kind, changes, said in CLAIMS:
        own = {key: value for key, value in changes.items() if key != "folder"}
        home = write_submission(root, perfect, changes.get("folder", "second"), **own)
        if "supersedes" in changes:  # as earlier submissions have it
            toml = home / "submission.toml"
            toml.write_text('supersedes = "nothing"\n' + toml.read_text())
        found = checked(home, data)
        assert any(said in str(one) for one in (found.errors, found.warnings)[kind == "note"])
        assert bool(found.errors) == (kind == "error")
        shutil.rmtree(home)


def test_poses_that_are_the_prior_belong_to_its_class() -> None:
    result = made_method({"east": {"recall@1": [1.0] * 10}}).result
    counts = {scene: c | {"near_prior": 2} for scene, c in result.counts.items()}
    result = result.model_copy(update={"counts": counts})
    with pytest.raises(SubmissionError, match="2 of 10 poses are the photo's own prior"):
        checks.check_pipeline(submission(), result)
    checks.check_pipeline(
        submission(pipeline={"stages": "single-stage", "uses": ["prior"]}), result
    )


def test_submissions_of_this_repository_are_sound_and_small(tmp_path: Path) -> None:
    """Those on AirZoo-Mini are scored where it is made: tests/datasets/mini/test_prepare.py."""
    board, known = read_board(CHECKOUT / BOARD_FILE), known_submissions(CHECKOUT)
    assert {place.benchmark for place in known} >= {"airzoo-demo", "airzoo-mini"}
    for place in known:
        assert not checks.check_submission(
            CHECKOUT / place.path, board, tmp_path, known=known
        ).errors
    assert checks.size_of_tree(CHECKOUT / "submissions") < 1_500_000


# --- submit ---

OPTIONS = [
    *("--method", "SALAD", "--team", "Example Lab", "--contact", "ada@example.org"),
    *("--author", "Ada Example", "--author", "Grace Example", "--licence", "CC-BY-4.0"),
    *("--training-data", "none", "--stages", "single-stage", "--set", f"account={ADA}"),
]
FOLDER = f"{HOME}/salad"


@pytest.fixture
def preds(tmp_path: Path, root: Path, perfect: Any, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return predictions; the current folder is that of a board."""
    monkeypatch.chdir(root)
    return write_predictions(tmp_path / "preds.npz", PROTOCOL, **perfect)


def test_one_command_makes_a_branch_with_the_checked_folder(
    root: Path, preds: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in AUTHOR.items():
        monkeypatch.setenv(name, value)
    git(root, "init", "--quiet", "-b", "main")
    git(root, "add", "-A")
    git(root, "commit", "--quiet", "-m", "A board")
    more = ("--set", 'pipeline.uses=["prior"]', "--set", "code=https://example.org/salad")
    made = run("submit", preds, *OPTIONS, *more)
    assert "checked and scored, nothing wrong" in made.stdout
    steps = ["git push -u origin submit-salad", "gh pr create --fill"]
    assert made.stdout.splitlines()[-2:] == steps
    changed = git(root, "show", "--name-only", "--format=%s", "submit-salad").splitlines()
    names = ("preds.npz", "submission.toml")
    assert changed == ["SALAD on made, retrieval", "", *(f"{FOLDER}/{name}" for name in names)]
    stated = read_submission(root / FOLDER / "submission.toml")
    assert (stated.protocol, stated.account, stated.training_data) == (PROTOCOL, ADA, ())
    assert stated.pipeline.uses == ("prior",)


def test_options_that_are_wrong(root: Path, preds: Path) -> None:
    for options, said in (
        (OPTIONS[:2], "--team, --contact, --author, --licence, --training-data, --stages"),
        ([*OPTIONS, "--protocol", "made-retrieva"], "did you mean 'made-retrieval'"),
        ([*OPTIONS, "--set", "paper"], "key 'paper' is ''"),
        ([*OPTIONS, "--set", "papr=https://a.org"], "papr"),
    ):
        assert said in str(run("submit", preds, *options, code=1).exception)
        assert not (root / "submissions").exists()


def test_an_earlier_version_is_replaced_only_by_force(root: Path, preds: Path) -> None:
    call = ("submit", preds, *OPTIONS, "--no-commit")
    run(*call, "--url", "https://example.org/preds.npz")  # which is not copied
    assert [path.name for path in (root / FOLDER).iterdir()] == ["submission.toml"]
    stated = read_submission(root / FOLDER / "submission.toml").predictions
    assert (stated.url, stated.size) == ("https://example.org/preds.npz", preds.stat().st_size)
    assert "--force" in str(run(*call, code=1).exception)
    run(*call, "--force", "--set", "summary=Newer")
    assert read_submission(root / FOLDER / "submission.toml").summary == "Newer"


def test_eight_questions_at_most_on_a_terminal(
    root: Path, preds: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = SimpleNamespace(isatty=lambda: True)
    streams = SimpleNamespace(stdin=terminal, stderr=terminal)
    monkeypatch.setattr("airzoo_bench.leaderboard.submitting.sys", streams)
    given = ("SALAD", "Example Lab", "nobody", "ada@example.org", "Ada Example, Grace Example")
    answers = "\n".join((*given, "CC-BY-4.0", "none", "single-stage", ""))
    made = CliRunner().invoke(app, ["submit", str(preds), "--no-commit"], input=answers)
    assert made.exit_code == 0, made.output
    assert "'nobody'" in made.output  # asked again
    stated = read_submission(root / FOLDER / "submission.toml")
    assert (stated.method, stated.authors) == ("SALAD", ("Ada Example", "Grace Example"))
    assert (stated.training_data, stated.pipeline.stages) == ((), "single-stage")
