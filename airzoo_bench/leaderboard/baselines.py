"""Submissions that the suite's own baselines made, which CI can make again without strange code."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args, get_type_hints

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.files import sha256_of_tree, temporary_folder
from airzoo_bench.core.registry import TRACKS, Option
from airzoo_bench.core.validation import nearest, toml_value
from airzoo_bench.evaluation.evaluate import evaluate, run_baseline
from airzoo_bench.evaluation.info import Baseline
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission
from airzoo_bench.results.result import Result

__all__ = ["Remade", "check_baseline", "remake"]


_KINDS = {bool: "true or false", int: "a whole number", float: "a number"}


@dataclass(frozen=True)
class Remade:
    """A baseline's predictions, made once more.

    Attributes
    ----------
    same_bytes : bool
        Whether they are those of the submission, to the last byte.
    alike : bool
        Whether they are, or score as those of the submission do; what does not is another method,
        and its time is not that of this one.
    seconds : float
        That it took, with all preparation.
    """

    same_bytes: bool
    alike: bool
    seconds: float


def check_baseline(submission: Submission, track: str) -> Iterator[UserError]:
    """Yield an error where the settings are none of the track's baseline."""
    if submission.baseline is None:
        return
    baseline: Baseline | None = TRACKS.get(track).baseline
    fields = {} if baseline is None else _fields(baseline.settings)
    options = {option.name: (kind, option) for kind, option in fields.values()}
    for name, value in submission.baseline.items():
        if name not in options:
            yield SubmissionError(
                f"key 'baseline.{name}' is no setting of the {track} baseline"
                f"{nearest(name, [*options])}",
                where=SUBMISSION_FILE,
                expected=f"one of {', '.join(options) or 'none: the track has no baseline'}",
                fix="correct it, or leave out [baseline] where the suite's baseline did not make "
                "the predictions",
            )
        elif problem := _problem(value, *options[name]):
            yield SubmissionError(
                f"key 'baseline.{name}' is {toml_value(value)}: {problem}",
                where=SUBMISSION_FILE,
                expected=options[name][1].help,
            )


def _fields(settings: Any) -> dict[str, tuple[type, Option]]:
    """Return type and option of each setting that is an option, by the field's name."""
    hints = get_type_hints(type(settings), include_extras=True)
    found = {}
    for name, hint in hints.items():
        kind, *extras = get_args(hint) or (None,)
        options = [one for one in extras if isinstance(one, Option)]
        if options:
            found[name] = (kind, options[0])
    return found


def _problem(value: bool | float, kind: type, option: Option) -> str:
    """Say why a value is none of an option, if it is none."""
    if kind is bool or isinstance(value, bool):
        return "" if kind is bool and isinstance(value, bool) else f"not {_KINDS.get(kind)}"
    if kind is int and not isinstance(value, int):
        return "not a whole number"
    least = -math.inf if option.least is None else option.least
    most = math.inf if option.most is None else option.most
    return "" if least <= value <= most else f"not from {least:g} to {most:g}"


def remake(
    submission: Submission,
    track: str,
    predictions: Path,
    agrees: Callable[[Result], bool],
    *,
    data: Path,
    run: Run,
) -> Remade:
    """Make the predictions of a baseline again, compare them to the byte, and time it."""
    baseline: Baseline = TRACKS.get(track).baseline
    fields = {option.name: name for name, (_, option) in _fields(baseline.settings).items()}
    changes = {fields[name]: value for name, value in (submission.baseline or {}).items()}
    with temporary_folder(Path(tempfile.gettempdir()), "airzoo-bench") as folder:
        out = folder / predictions.name
        begin = time.perf_counter()
        run_baseline(
            track,
            submission.protocol,
            out,
            data=data,
            settings=replace(baseline.settings, **changes),
            run=run,
        )
        seconds = time.perf_counter() - begin
        same = sha256_of_tree(out) == sha256_of_tree(predictions)
        alike = same or agrees(
            evaluate(out, data=data, protocol=submission.protocol, run=run).result
        )
        return Remade(same, alike, seconds)
