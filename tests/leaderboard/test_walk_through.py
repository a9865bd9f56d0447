"""A board from nothing to a page, by real git: submit, pull request, comment, merge, board."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any
from unittest import mock

from airzoo_bench.core.sandbox import Limits, call_limited
from airzoo_bench.evaluation import predictions
from airzoo_bench.leaderboard.checks import CheckedSubmission
from tests.leaderboard import conftest as world
from tests.leaderboard.conftest import ADA, BOB, HOME, PROTOCOL, RUNS, Board, write_submission
from tests.support import made_protocol, run_main, write_benchmark, write_predictions


def worse(perfect: Any) -> Any:
    """Return predictions whose every second query is answered badly."""
    ranked = [row[::-1] if n % 2 else row for n, row in enumerate(perfect["ranked_ids"])]
    return {**perfect, "ranked_ids": ranked}


def test_from_an_empty_repository_to_a_board_and_off_it(board: Board, perfect: Any) -> None:
    ada = board.clone("ada")
    preds = write_predictions(board.home / "preds.npz", PROTOCOL, **worse(perfect))
    for name in ("Vinegar", "Salad"):  # the second begins at the board's branch too
        made = world.run("submit", preds, *world.OPTIONS, "--method", name, "--board", ada)
    push = "git push --force -u origin submit-made-retrieval-salad"
    *_, checked, pushed, asked = made.stdout.splitlines()
    assert checked.startswith(str(ada / HOME / "salad"))
    assert (pushed, asked) == (push, "gh pr create --fill")
    world.git(ada, *push.split()[1:])
    comment, head = board.ci(1, ada), world.git(ada, "rev-parse", "HEAD")
    for said in ("### `Salad` by `Example Lab`", "Rank **1** of 1", "| `Scene east` | 6 |", head):
        assert said in comment
    board.merge(1)
    site = world.files_of(board.build(said="scored"))
    assert b"Salad" in site["index.html"]
    assert b'"near_best":true' not in site["board.json"]  # of one method alone
    shown = [*site.values(), board.data_file(f"{RUNS}/salad/1/submission.toml").encode()]
    assert not [text for text in (comment.encode(), *shown) if b"ada@example.org" in text]

    # Nothing is scored twice, and the pages are the same to the last byte.
    tip = world.git(board.hosted.folder, "rev-parse", "leaderboard-data")
    assert world.files_of(board.build()) == site
    assert board.log.stderr == ""
    assert world.git(board.hosted.folder, "rev-parse", "leaderboard-data") == tip

    # The next version of the same account says what has changed; a stale branch may be another's.
    write_submission(ada, perfect, method="Salad")
    assert "has changed on the board since" in board.ci(1, ada, code=1)
    write_submission(ada := board.clone("ada2"), perfect, method="Salad")
    assert "| the last version | 10 |" in board.ci(2, ada)
    board.merge(2)
    board.step("keep", board.rescore())
    assert json.loads(board.data_file(f"{RUNS}/salad/2/run.json"))["tree"]

    # A second method is placed beside the first; anybody can write a team's name. Answers that
    # are another team's are told, whatever file they come in.
    copied = {name: rows[::-1] for name, rows in perfect.items()}
    facts = {"folder": "vinegar", "method": "Vinegar", "account": BOB}
    write_submission(bob := board.clone("bob"), copied, team="Other Lab", **facts)
    assert f"write account = {ADA}" in board.ci(3, bob, ADA, code=1)
    comment = board.ci(3, bob, world.MAINTAINER)
    assert "of 2 by" in comment
    assert "100 % of the records are those of 'Salad' of team 'Example Lab'" in comment
    write_submission(bob, worse(perfect), **facts)
    said = "team 'Example Lab' is on the board already, by another account"
    assert said in board.ci(3, bob, BOB)

    # A withdrawn submission leaves the board, and its folder keeps its owner.
    shutil.rmtree((ada := board.clone("ada3")) / HOME / "salad")
    assert "is withdrawn" in board.ci(4, ada, world.MAINTAINER)  # who may change every folder
    board.merge(4)
    assert not list(board.rescore().rglob("run.json"))
    assert board.data_file(f"{RUNS}/salad/1/run.json")
    write_submission(bob := board.clone("bob2"), perfect, team="Other Lab", account=BOB)
    assert "belongs to another account" in board.ci(5, bob, BOB, code=1)


def test_only_changes_are_scored_again_and_what_is_merged_past_ci_stops_no_other(
    board: Board, data: Path, scenes: Any, perfect: Any
) -> None:
    write_submission(board.main, perfect, method="Salad")
    board.push(board.main)
    limits = mock.patch("airzoo_bench.cli.leaderboard.Limits", Limits)
    with limits, mock.patch.object(predictions, "call_limited", wraps=call_limited) as read:
        board.step("keep", board.rescore())
    assert read.called  # strangers' predictions are read under limits

    # Of two names that look alike the one that has a run stays.
    write_submission(board.main, perfect, method="Salad", summary="Other words")
    for name, method in {"aaa": "aaa", "cress": "SALAD", "sound": "sound"}.items():
        facts = {"folder": name, "method": method, "team": f"Team {name}", "account": BOB}
        write_submission(board.main, worse(perfect), **facts)
    (board.main / HOME / "aaa/link").symlink_to("/")
    (board.main / HOME / "whole").symlink_to("salad")
    board.push(board.main)
    own = {"side_effect": CheckedSubmission.score, "autospec": True}
    with mock.patch.object(CheckedSubmission, "score", **own) as score:
        found = board.rescore(code=1, said="new words, the same scores")
    assert [call.args[0].folder.name for call in score.call_args_list] == ["sound"]
    assert sorted(path.parent.name for path in found.glob(f"{RUNS}/*/1")) == ["salad", "sound"]
    faults = {p.parent.name: p.read_text() for p in found.glob(f"{RUNS}/*/fault.txt")}
    assert sorted(faults) == ["aaa", "cress"]
    assert "link" in faults["aaa"]
    assert "differs from 'Salad' only in case" in faults["cress"]
    board.step("keep", found)
    assert "fault" not in world.git(board.hosted.folder, "ls-tree", "-r", "leaderboard-data")
    assert "Other words" in board.data_file(f"{RUNS}/salad/1/submission.toml")

    # Another version of the protocol, and another truth.
    protocol = data / f"made/protocols/{PROTOCOL}.toml"
    text = protocol.read_text()
    protocol.write_text(text.replace("\nversion = 3", "\nversion = 4", 1))
    again = board.rescore(code=1, said="scored again")
    assert sorted(path.name for path in again.glob(f"{RUNS}/salad/*")) == ["1", "2"]
    protocol.write_text(text)
    shutil.rmtree(data / "made")
    changed = [replace(scenes[0], positives=scenes[0].positives[::-1]), *scenes[1:]]
    write_benchmark(data / "made", made_protocol(changed), changed)
    board.rescore(code=1, said="scored again")


def test_faults_of_the_board_are_no_refusal(board: Board, tmp_path: Path, capsys: Any) -> None:
    head = board.push(board.main, "pull/1/head")
    event = board.score(1, head).with_name("event.json")
    (wrong := tmp_path / "wrong").mkdir()  # no sound board, no repository, and not empty
    (file := wrong / "leaderboard.toml").write_text("{}")
    sound = {"--event": event, "--root": board.main, "--remote": board.hosted.folder}
    for option in (*sound, "--work"):
        places = sound | {"--work": tmp_path / f"work{option}", "--out": tmp_path / "found.json"}
        places[option] = file if option == "--event" else wrong
        assert run_main("leaderboard", "score", *chain(*places.items())) == 2
        assert capsys.readouterr().err.count("airzoo-bench: ") == 1
    assert not (tmp_path / "found.json").exists()
