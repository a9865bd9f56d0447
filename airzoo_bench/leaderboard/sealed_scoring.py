"""Scoring against a sealed truth, and how coarse the answer is.

Told are the headline scores over all scenes, in steps of half their standard error. It is that of a
mean of scenes that are independent of each other; within a scene it is

- of **shares** (recalls, average precision) that of a rate, with two more queries at 0 and two at 1
  (Agresti and Coull 1998), made from the score as it is told; steps are those of the largest
  error that so many queries can have, and not smaller than what `FLIPS` queries of the smallest
  scene move, so that they tell nothing;
- of **means of errors** that of the sample;
- of **medians** a quarter of the width of the interval of order statistics that the binomial
  distribution gives for 95 %. Where its upper end is a failure the error is not known, and its
  lower half decides how coarse the median is told.

Errors are rounded upward to one digit; of medians and means of errors to 1, 2 or 5. Reconstruction
has one record a scene: shares are told to a hundredth, distances to two digits.
"""

from __future__ import annotations

import io
import math
import os
import shutil
import tarfile
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from decimal import ROUND_CEILING, Context, Decimal
from pathlib import Path
from typing import IO, Any

import numpy as np
from pydantic import ValidationError

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.errors import BenchmarkError, SubmissionError, UserError
from airzoo_bench.core.files import clear_abandoned, sha256_of, temporary_folder
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.evaluation.evaluate import Evaluation, check, evaluate
from airzoo_bench.evaluation.opening import ReadBy
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.checks import check_pipeline
from airzoo_bench.leaderboard.data_branch import Estimate, SealedAnswer
from airzoo_bench.leaderboard.sealing import (
    MANIFEST,
    Contents,
    commitment,
    load_pyrage,
)
from airzoo_bench.leaderboard.submission import Submission
from airzoo_bench.protocol.model import find_protocol
from airzoo_bench.results.result import ScoreColumn

FLIPS = 4
"""Steps are at least as large as what so many queries of the smallest scene can move a share."""

_Z95 = 1.959964
_LEAST_SHARE_OF_VALUE = 0.01
_ONE_UP, _TWO_UP = (Context(prec=digits, rounding=ROUND_CEILING) for digits in (1, 2))
_MEMORY = Path("/dev/shm")  # files in memory, on Linux
_NAME = "airzoo-truth"


class OpenedTruthError(SubmissionError):
    """Why predictions are refused once the truth is open: that too is an answer, and a try."""


def score_sealed(
    predictions: Path,
    protocol: str,
    method: str,
    archive: Path,
    key: Any,
    *,
    data: Path,
    read_by: ReadBy = ReadBy(),  # noqa: B008 - frozen
    run: Run = Run(),  # noqa: B008 - frozen
    stated: Submission | None = None,
) -> SealedAnswer:
    """Score predictions, and tell of it what does not tell the truth."""
    public = find_benchmark(find_protocol(protocol, data).benchmark, data, sealed=True)
    clear_abandoned(_truth_home() / _NAME)  # what a killed run has left
    # What can be said of predictions without the truth is said before it is opened.
    given: dict[str, Any] = {"protocol": protocol, "run": run, "read_by": read_by}
    for error in check(predictions, data=public.folder, **given).errors:
        raise error
    with opened_truth(public.folder, archive, key) as truth:
        try:
            evaluation = evaluate(predictions, data=truth, method=method, **given)
        except UserError:
            # What it says may come from the truth.
            raise OpenedTruthError(
                "cannot be scored, for a reason that only the truth shows, and that is not told",
                where=predictions,
                fix="ask the host, who has the truth and can score it by `airzoo-bench eval`",
            ) from None
        fault = check_pipeline(stated, evaluation.result) if stated else None
        if fault is not None:
            raise OpenedTruthError(fault.what, expected=fault.expected, fix=fault.fix)
    result, sealed = evaluation.result, public.file.sealed
    columns = tuple(column for column in result.columns if column.headline)
    return SealedAnswer(
        schema=1,
        track=result.track,
        protocol=result.protocol.name,
        protocol_version=result.protocol.version,
        protocol_fingerprint=result.protocol.fingerprint,
        benchmark=result.truth.benchmark,
        truth_commitment="" if sealed is None else sealed.commitment,
        method=result.predictions.method,
        predictions_sha256=result.predictions.sha256,
        columns=columns,
        queries={scene: counts["queries"] for scene, counts in result.counts.items()},
        scene_titles=result.truth.scene_titles,
        overall=round_overall(evaluation, columns),
        versions=result.versions,
    )


# --- how coarse ---


def round_overall(evaluation: Evaluation, columns: Sequence[ScoreColumn]) -> dict[str, Estimate]:
    """Round the scores over all scenes."""
    result, records = evaluation.result, evaluation.records
    of_scene = records["scene"].to_numpy(str)
    found = {}
    for column in columns:
        values = records[column.key].to_numpy(np.float64)
        if TRACKS.get(result.track).unit == "scene":
            found[column.key] = _round_scenes(result.overall[column.key], values, column)
        else:
            scenes = [values[of_scene == scene] for scene in result.scenes]
            found[column.key] = round_score(result.overall[column.key], scenes, column)
    return found


def round_score(value: float, scenes: Sequence[Floats], column: ScoreColumn) -> Estimate:
    """Round the mean over scenes of a score, made of the values of their queries."""
    if math.isinf(value):
        return Estimate(value=None, standard_error=None)
    count, sizes = len(scenes), np.array([len(values) for values in scenes])
    if column.unit == "share" and column.average == "mean":
        width = _up(math.hypot(*(0.5 / np.sqrt(sizes))) / count, _ONE_UP)
        step = max(width / 2, _up(FLIPS / float(sizes.min()) / count, _TWO_UP))
        shown = min(_nearest(value, step), 1.0)
        rates = (shown * sizes + 2) / (sizes + 4)
        error: float | None = math.hypot(*np.sqrt(rates * (1 - rates) / sizes)) / count
    else:
        spreads = [_spread(values, column) for values in scenes]
        width = _up_to_few(_up(math.hypot(*(wide for _, wide in spreads)) / count, _ONE_UP))
        step = width / 2
        shown = _nearest(value, step)
        known = [error for error, _ in spreads if error is not None]
        error = math.hypot(*known) / count if len(known) == count else None
    stated = None if error is None else float(_up(error, _ONE_UP))
    return Estimate(value=shown, standard_error=stated, step=float(step))


def _spread(values: Floats, column: ScoreColumn) -> tuple[float | None, float]:
    """Return the standard error of a scene's score, if it is known, and a width for steps."""
    count = len(values)
    if column.average == "median":
        ranked, middle = np.sort(values), float(np.median(values))
        reach = _Z95 * math.sqrt(count) / 2
        low = float(ranked[max(0, math.floor(count / 2 - reach))])
        high = float(ranked[min(count - 1, math.ceil(count / 2 + reach))])
        if math.isinf(high):
            return None, _not_zero((middle - low) / _Z95, middle)
        error = _not_zero((high - low) / (2 * _Z95), middle)
        return error, error
    mean = float(values.mean())
    if count < 2:
        return None, abs(mean)
    error = _not_zero(float(values.std(ddof=1)) / math.sqrt(count), mean)
    return error, error


def _round_scenes(value: float, values: Floats, column: ScoreColumn) -> Estimate:
    """Round a score that has one record a scene."""
    if math.isinf(value):
        return Estimate(value=None, standard_error=None)
    step = Decimal("0.01")
    if column.unit != "share":
        step = Decimal(1).scaleb(Decimal(value).adjusted() - 1 if value else -2)
    known = len(values) > 1 and bool(np.isfinite(values).all())
    error = float(values.std(ddof=1)) / math.sqrt(len(values)) if known else None
    stated = None if error is None else float(_up(error, _ONE_UP))
    return Estimate(value=_nearest(value, step), standard_error=stated, step=float(step))


def _not_zero(error: float, value: float) -> float:
    return max(error, _LEAST_SHARE_OF_VALUE * abs(value))


def _up(number: float, context: Context) -> Decimal:
    return context.create_decimal(repr(float(number)))


def _up_to_few(width: Decimal) -> Decimal:
    """Round one digit up to 1, 2, 5 or 10, so that steps are mostly those of a similar sample."""
    unit = Decimal(1).scaleb(width.adjusted())
    return next(unit * digit for digit in (1, 2, 5, 10) if width <= unit * digit)


def _nearest(value: float, step: Decimal) -> float:
    return float(round(Decimal(repr(value)) / step) * step) if step else value


# --- the archive ---


@contextmanager
def opened_truth(public: Path, archive: Path, key: Any) -> Iterator[Path]:
    """Open as much of the folder that was sealed as scoring needs, in memory where that can be.

    The folder holds the truth, and links to public files. Photos may be missing.
    """
    sealed = Benchmark.open(public, sealed=True).file.sealed
    if sealed is None:
        expected = "the public folder that `airzoo-bench seal` wrote"
        raise BenchmarkError("is not sealed: the truth is in it", where=public, expected=expected)
    home = _truth_home()
    try:
        with temporary_folder(home, _NAME) as folder:
            contents = _extract(archive, key, sealed.commitment, folder)
            for name, file in contents.files.items():
                if file.how == "public":
                    if not (public / name).is_file():
                        what = "a file of the public folder is missing"
                        raise BenchmarkError(what, where=public / name, fix="copy the folder again")
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    (folder / name).symlink_to((public / name).resolve())
            yield folder
    except OSError as error:
        if not str(error.filename or home).startswith(str(home)):
            raise
        what = f"the truth cannot be opened: {error.strerror or error}"
        raise UserError(what, where=home, fix="make room there") from error


def _truth_home() -> Path:
    return _MEMORY if os.access(_MEMORY, os.W_OK | os.X_OK) else Path(tempfile.gettempdir())


def _extract(archive: Path, key: Any, committed: str, target: Path) -> Contents:
    """Write the sealed files of an archive, each held to its checksum."""
    if not archive.is_file():
        raise _wrong_archive(archive, "no such archive")
    with tempfile.TemporaryFile(dir=target) as plain:
        _decrypt(archive, key, plain)
        try:
            with tarfile.open(fileobj=plain, mode="r:") as tar:
                member = tar.extractfile(MANIFEST)
                contents = Contents.model_validate_json(member.read() if member else b"")
                if commitment(contents) != committed:
                    raise _wrong_archive(archive, "belongs to another public folder")
                for name, file in contents.files.items():
                    if file.how == "sealed":  # the manifest keeps its name inside the folder
                        member, path = tar.extractfile(f"files/{name}"), target / name
                        path.parent.mkdir(parents=True, exist_ok=True)
                        with path.open("wb") as stream:
                            shutil.copyfileobj(member or io.BytesIO(), stream)
                        if sha256_of(path) != file.sha256:
                            what = f"holds {name} otherwise than it was sealed"
                            raise _wrong_archive(archive, what)
        except (tarfile.TarError, KeyError) as error:
            raise _wrong_archive(archive, f"lacks a file of the truth: {error}") from None
        except ValidationError as error:
            what = f"an archive of another version: {error.errors()[0]['msg']}"
            raise _wrong_archive(archive, what) from None
    return contents


def _decrypt(archive: Path, key: Any, plain: IO[bytes]) -> None:
    pyrage = load_pyrage()
    try:
        with archive.open("rb") as stream:
            pyrage.decrypt_io(stream, plain, [key])
    except (pyrage.DecryptError, OSError) as error:
        if isinstance(error, OSError) and error.errno:  # the disk, not the archive
            raise
        no_key = "No matching keys" in str(error)
        what = "is damaged, cut off, or no archive of age"
        what = "was sealed to another key, or its head is damaged" if no_key else what
        raise _wrong_archive(archive, what) from None
    plain.seek(0)


def _wrong_archive(archive: Path, what: str) -> BenchmarkError:
    expected = "the archive, and its key, of the run of `airzoo-bench seal` that made the folder"
    return BenchmarkError(what, where=archive, expected=expected, fix="copy the archive again")
