"""Scoring against a sealed truth: in a job of its own, with the key and without network."""

from __future__ import annotations

import shutil
import socket
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import SubmissionError, UsageError
from airzoo_bench.leaderboard.checks import check_submission
from airzoo_bench.leaderboard.ci.artifact import Artifact, problem_of
from airzoo_bench.leaderboard.ci.scoring import Rules
from airzoo_bench.leaderboard.predictions_given import FETCHED
from airzoo_bench.leaderboard.sealed.scoring import OpenedTruthError, score_sealed

__all__ = ["check_no_network", "score_against_truth"]


def check_no_network() -> None:
    """Refuse to open a truth where anything could carry it away."""
    others = [name for _, name in socket.if_nameindex() if name != "lo"]
    if others:
        raise UsageError(
            f"a sealed truth is not opened while there is a network ({', '.join(others)})",
            fix="run it by `unshare --net`, as the workflow does",
        )


def score_against_truth(artifact: Artifact, work: Path, rules: Rules, key: Any) -> Artifact:
    """Score a submission that an earlier job has checked."""
    place = artifact.place
    if (work / FETCHED).is_dir():
        shutil.copytree(work / FETCHED, rules.data / FETCHED, dirs_exist_ok=True)
    checked = check_submission(work / place.path, rules.board, rules.data, run=rules.run)
    for error in checked.errors:
        raise error
    benchmark = next(one for one in rules.board.benchmarks if one.name == place.benchmark)
    if artifact.kind != "sealed" or benchmark.sealed is None:
        raise SubmissionError("the truth of this benchmark is not sealed", where=place.path)
    archive = rules.root / benchmark.sealed
    try:
        answer = score_sealed(checked, archive, key, data=rules.data, run=rules.run)
    except OpenedTruthError as error:
        problem = problem_of(error).model_copy(update={"where": place.path})
        update = {"kind": "refused", "problems": (problem,), "truth": "opened"}
        return artifact.model_copy(update=update)
    return artifact.model_copy(update={"answer": answer, "truth": answer.truth_commitment})
