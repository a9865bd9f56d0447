"""The host's worker of a challenge on EvalAI: it takes submissions, scores them, tells the scores.

``python3 -m airzoo_bench.leaderboard.exports.evalai_worker FOLDER``, with AUTH_TOKEN, API_SERVER,
QUEUE_NAME and CHALLENGE_PK in the environment. Each submission is scored by a process of its own,
which does not have the token.
"""

from __future__ import annotations

import http.client
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import SubmissionError, UsageError
from airzoo_bench.core.files import read_text
from airzoo_bench.leaderboard.exports.evalai_api import Api
from airzoo_bench.leaderboard.exports.scoring import ERRORS_FILE, MESSAGE_FILE, SCORES_FILE
from airzoo_bench.leaderboard.exports.settings import FAILED, SETTINGS_FILE, read_settings

__all__ = ["FAILED_LABEL", "PROGRAM", "REFERENCE", "Worker", "error_label", "main", "scored"]

PROGRAM, REFERENCE = "program", "reference"
"""Folders of a worker: settings of the scoring program, and the truth."""
FAILED_LABEL = "Failed"

_VARIABLES = ("AUTH_TOKEN", "API_SERVER", "QUEUE_NAME", "CHALLENGE_PK")
_PAUSE_S = 60.0
_DONE = ("finished", "failed", "cancelled")
_MOST_S = 6 * 3600
_OURS = "the scoring program of the challenge's host failed; this is no fault of the submission"


def error_label(title: str) -> str:
    """Name the column of a score's error bar.

    EvalAI shows the error bars of its own workers only; of a host's it takes scores alone.
    """
    return f"± {title}"


def scored(submission: Path, folder: Path) -> dict[str, Any]:
    """Score a submission in a process of its own.

    Parameters
    ----------
    submission : Path
        A file.
    folder : Path
        The worker's.

    Returns
    -------
    dict
        ``{"result": [{split: {label: score}}], "error": [{split: {label: half width}}]}``.

    Raises
    ------
    SubmissionError
        The submission is at fault.
    RuntimeError
        The scoring program is.
    """
    settings = read_settings(folder / PROGRAM / SETTINGS_FILE)
    with tempfile.TemporaryDirectory() as temporary:
        values, errors = _run(submission.resolve(), folder.resolve(), Path(temporary))
    titles = {column.key: column.title for column in settings.columns}
    shown = {titles[key]: values[key] for key in titles}
    half_widths = {titles[key]: errors[key] for key in titles}
    shown |= {error_label(title): value for title, value in half_widths.items()}
    result = shown | {FAILED_LABEL: values[FAILED]}
    return {"result": [{settings.protocol: result}], "error": [{settings.protocol: half_widths}]}


def _run(submission: Path, folder: Path, home: Path) -> tuple[dict[str, float], dict[str, float]]:
    given, out = home / "input", home / "output"
    (given / "res").mkdir(parents=True)
    out.mkdir()
    (given / "ref").symlink_to(folder / REFERENCE, target_is_directory=True)
    shutil.copyfile(submission, given / "res" / submission.name)
    program = "airzoo_bench.leaderboard.exports.scoring"
    call = [sys.executable, "-m", program, str(folder / PROGRAM), str(given), str(out)]
    kept = {name: value for name, value in os.environ.items() if name not in _VARIABLES}
    done = subprocess.run(
        call, env=kept, capture_output=True, text=True, timeout=_MOST_S, check=False
    )
    if (out / MESSAGE_FILE).is_file():
        raise SubmissionError(read_text(out / MESSAGE_FILE, SubmissionError, "message").strip())
    if done.returncode or not (out / SCORES_FILE).is_file():
        raise RuntimeError(done.stderr)
    return json.loads((out / SCORES_FILE).read_text()), json.loads((out / ERRORS_FILE).read_text())


@dataclass(frozen=True)
class Worker:
    """A challenge's queue, and the folder that scores what comes out of it."""

    api: Api
    folder: Path
    queue: str
    challenge: int

    def step(self) -> bool:
        """Take a submission out of the queue, and tell its scores; whether there was one.

        A message stays in the queue until its submission has been told of, so that what is scored
        when the worker is stopped is scored again.
        """
        message = self.api.call("GET", f"/api/jobs/challenge/queues/{self.queue}/")
        body = message.get("body")
        if not body:
            return False
        submission = self.api.call("GET", f"/api/jobs/submission/{int(body['submission_pk'])}")
        if int(body["challenge_pk"]) == self.challenge and submission.get("status") not in _DONE:
            self._evaluate(submission, int(body["submission_pk"]), int(body["phase_pk"]))
        handle = {"receipt_handle": message["receipt_handle"]}
        self.api.call("POST", f"/api/jobs/queues/{self.queue}/", handle)
        return True

    def _evaluate(self, submission: Mapping[str, Any], number: int, phase: int) -> None:
        place = f"/api/jobs/challenge/{self.challenge}/update_submission/"
        running = {"submission": number, "submission_status": "RUNNING"}
        self.api.call("PATCH", place, running)
        with tempfile.TemporaryDirectory() as temporary:
            file = self.api.download(str(submission["input_file"]), Path(temporary))
            answer = _answer(file, self.folder)
        self.api.call("PUT", place, {"challenge_phase": phase, "submission": number, **answer})


def _answer(file: Path, folder: Path) -> dict[str, str]:
    """Return what EvalAI is told of a submission."""
    try:
        output = scored(file, folder)
    except SubmissionError as error:
        return _told("FAILED", stderr=str(error))
    except (RuntimeError, subprocess.TimeoutExpired) as error:
        sys.stderr.write(f"{error}\n")
        return _told("FAILED", stderr=_OURS)
    [(split, values)] = output["result"][0].items()
    entry = {"split": split, "show_to_participant": True, "accuracies": values}
    entry["error"] = output["error"][0][split]
    return _told("FINISHED", stdout="scored", result=json.dumps([entry], allow_nan=False))


def _told(status: str, *, stdout: str = "", stderr: str = "", result: str = "[]") -> dict[str, str]:
    texts = {"stdout": stdout, "stderr": stderr, "result": result}
    return {"submission_status": status, **texts, "metadata": "{}"}


def main(arguments: Sequence[str], *, endless: bool = True, pause: float = _PAUSE_S) -> int:
    """Work until stopped, or until the queue is empty where not `endless`.

    Raises
    ------
    UsageError
        The worker's folder or a variable of the environment is missing.
    """
    if len(arguments) != 1 or not (Path(arguments[0]) / "program").is_dir():
        raise UsageError(
            "no worker's folder" if arguments else "no folder is named",
            where=" ".join(arguments) or None,
            expected="the folder worker that `airzoo-bench export evalai` wrote",
        )
    missing = [name for name in _VARIABLES if not os.environ.get(name)]
    if missing:
        raise UsageError(
            f"{', '.join(missing)} not set",
            where="the environment",
            expected="what EvalAI shows on a challenge's page Manage, and a profile's token",
        )
    token, server, queue, challenge = (os.environ[name] for name in _VARIABLES)
    worker = Worker(Api(server, token), Path(arguments[0]), queue, int(challenge))
    while True:
        try:
            busy = worker.step()
        except (OSError, http.client.HTTPException, ValueError, KeyError) as error:
            # The network, or an answer that is none; the message stays in the queue.
            sys.stderr.write(f"{type(error).__name__}: {error}\n")
            busy = False
        if not busy:
            if not endless:
                return 0
            time.sleep(pause)


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except UsageError as error:
        sys.stderr.write(f"airzoo-bench: {error}\n")
        sys.exit(2)
