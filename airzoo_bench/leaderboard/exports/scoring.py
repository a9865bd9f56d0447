"""The scoring program that runs on other platforms: folders in, ``scores.json`` out.

``python3 -m airzoo_bench.leaderboard.exports.scoring PROGRAM INPUT OUTPUT``, as Codabench lays
folders out: PROGRAM holds scoring.json, INPUT/ref the truth, INPUT/res what was submitted. Exit
code 1, message.txt, and no scores.json, where the submission is at fault.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import PredictionError, SubmissionError, UserError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.evaluation.evaluate import Evaluation, evaluate
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.leaderboard.exports.settings import (
    FAILED,
    SETTINGS_FILE,
    ScoringSettings,
    finite,
    read_settings,
)
from airzoo_bench.leaderboard.sealed.scoring import told_of
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Result
from airzoo_bench.results.sampling import score_intervals
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.layouts import scenes_table
from airzoo_bench.tables.render import render

__all__ = [
    "ERRORS_FILE",
    "MESSAGE_FILE",
    "SCORES_FILE",
    "Scores",
    "find_submitted",
    "main",
    "score",
]

# The platform's own, beside what was submitted, and what archives of macOS bring along.
_STATUS = "metadata"
_NO_PREDICTIONS = (_STATUS, "__MACOSX", ".DS_Store")
_CODE = "metadata.yaml"
_SEALED_MESSAGE = (
    "the predictions cannot be scored; what is wrong may tell of the truth, and so is not told\n"
    "  fix:      run `airzoo-bench check` on them, which finds all that shows without the truth"
)
_Z95 = 1.959964

_Told = dict[str, tuple[float, float]]

SCORES_FILE, ERRORS_FILE, MESSAGE_FILE = "scores.json", "errors.json", "message.txt"
"""What a run writes: scores by key, half widths of their intervals, why there are none."""


@dataclass(frozen=True)
class Scores:
    """What a platform is told.

    Attributes
    ----------
    values : dict of str to float
        By the columns' keys, and `FAILED`: all of them, each finite.
    errors : dict of str to float
        Half the width of the 95 % interval, the wider half where they differ; `WORST` where there
        is no interval. Of a sealed truth, from the standard errors that are told of it.
    result : Result
    """

    values: dict[str, float]
    errors: dict[str, float]
    result: Result


def score(predictions: Path, reference: Path, settings: ScoringSettings) -> Scores:
    """Score predictions against the truth of a bundle.

    Parameters
    ----------
    predictions : Path
        A file or folder.
    reference : Path
        The benchmark folder.
    settings : ScoringSettings

    Raises
    ------
    UserError
        The predictions are not as they must be.
    """
    protocol = reference / "protocols" / f"{settings.protocol}.toml"
    evaluation = evaluate(
        predictions,
        data=reference,
        track=settings.track,
        protocol=str(protocol),
        resources=Resources(jobs=os.cpu_count() or 1),
    )
    told = _coarse(evaluation, settings) if settings.sealed else _exact(evaluation, settings)
    values = {column.key: finite(column.score, told[column.key][0]) for column in settings.columns}
    errors = {column.key: finite(column.score, told[column.key][1]) for column in settings.columns}
    values[FAILED] = float(_failed(evaluation.result))
    return Scores(values, errors, evaluation.result)


def _exact(evaluation: Evaluation, settings: ScoringSettings) -> _Told:
    """Return values and half widths by the columns' keys."""
    method = Scored("", evaluation.result, evaluation.records)
    scores = [column.score for column in settings.columns]
    found = score_intervals(method, scores, ResamplingConfig()).overall
    told = {}
    for column, interval in zip(settings.columns, found, strict=True):
        value = evaluation.result.overall[column.score.key]
        told[column.key] = (value, _half_width(value, interval))
    return told


def _half_width(value: float, interval: Interval) -> float:
    if interval.low is None or interval.high is None or math.isinf(value):
        return math.inf
    return max(interval.high - value, value - interval.low)


def _coarse(evaluation: Evaluation, settings: ScoringSettings) -> _Told:
    """Return values as `sealed` tells them, with half widths from their standard errors."""
    scores = tuple(column.score for column in settings.columns)
    _, overall = told_of(evaluation, scores, _salt(evaluation.result))
    told = {}
    for column in settings.columns:
        one = overall[column.score.key]
        value = math.inf if one.value is None else one.value
        error = math.inf if one.standard_error is None else _Z95 * one.standard_error
        told[column.key] = (value, error)
    return told


def _salt(result: Result) -> str:
    """Return what nobody knows who does not know all of the truth, the same in every export."""
    return hashlib.sha256(b"scores of an export\0" + result.truth.fingerprint.encode()).hexdigest()


def _failed(result: Result) -> int:
    """Count queries that were not answered, or whose answer came to nothing."""
    return sum(c.get("failed", c.get("missing", 0)) for c in result.counts.values())


def find_submitted(folder: Path) -> Path:
    """Return the one file or folder that was submitted.

    Raises
    ------
    SubmissionError
        Code was submitted, or has run in place of predictions; or there is not one entry.
    """
    status = folder / _STATUS
    has_run = status.is_file() and re.search(r"^exitCode: *[0-9-]", _text(status), re.MULTILINE)
    if (folder / _CODE).exists() or has_run or status.is_dir():
        raise SubmissionError(
            f"code was submitted ({_CODE})",
            expected="predictions alone, which nothing is run of",
            fix=f"leave {_CODE} and {_STATUS} out of the archive",
        )
    there = sorted(path for path in folder.iterdir() if path.name not in _NO_PREDICTIONS)
    if len(there) != 1 or there[0].is_symlink():
        names = ", ".join(path.name for path in there[:5]) or "nothing"
        raise SubmissionError(
            f"the archive holds {names}",
            expected="one file or one folder of predictions",
            fix="zip the prediction file alone, or the folder of prediction files",
        )
    return there[0]


def _text(path: Path) -> str:
    with path.open(encoding="utf-8", errors="replace") as stream:
        return stream.read(1 << 16)


def main(arguments: Sequence[str]) -> int:
    """Score what was submitted, write ``scores.json``, and return the exit code."""
    program, given, out = map(Path, arguments)
    settings = read_settings(program / SETTINGS_FILE)
    try:
        scores = score(find_submitted(given / "res"), given / "ref", settings)
    except (PredictionError, SubmissionError) as error:
        message = _SEALED_MESSAGE if settings.sealed else _printable(error)
        # Where the folders of this machine lie is nobody's business.
        message = message.replace(f"{given / 'res'}/", "") + "\n"
        sys.stderr.write(message)
        with atomic_write(out / MESSAGE_FILE, "w") as stream:
            stream.write(message)
        return 1
    _write(out / ERRORS_FILE, scores.errors)
    if not settings.sealed:
        page = render(scenes_table(scores.result), "html")
        with atomic_write(out / "detailed_results.html", "w") as stream:
            stream.write(f'<!DOCTYPE html>\n<meta charset="utf-8">\n{page}')
    _write(out / SCORES_FILE, scores.values)
    return 0


def _printable(error: UserError) -> str:
    return "".join(c if c.isprintable() or c == "\n" else f"\\x{ord(c):02x}" for c in str(error))


def _write(path: Path, values: Mapping[str, float]) -> None:
    with atomic_write(path, "w") as stream:
        stream.write(json.dumps(values, indent=1, allow_nan=False) + "\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
