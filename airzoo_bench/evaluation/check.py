"""Checking predictions of whatever track, without looking at what is true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import (
    BenchmarkError,
    CameraError,
    PredictionError,
    UnreadableError,
    UserError,
)
from airzoo_bench.evaluation.given import Given, open_predictions, read_truths
from airzoo_bench.evaluation.notes import counts_apart, namesake_notes
from airzoo_bench.evaluation.parts import Assigned, Truth
from airzoo_bench.evaluation.resources import Resources

__all__ = ["Checked", "check"]


@dataclass(frozen=True)
class Checked:
    """What a check found.

    Attributes
    ----------
    errors : sequence of UserError
        What `evaluate` would refuse.
    notes : list of str
        What a person may wish to know besides.
    """

    errors: Sequence[UserError]
    notes: list[str]


def check(
    path: Path,
    *,
    data: Path,
    protocol: str | None = None,
    resources: Resources = Resources(),  # noqa: B008 - frozen
) -> Checked:
    """Find all that is wrong with predictions.

    Where the benchmark folder is there, they are held against its queries, tiles, photos and
    priors.

    Parameters
    ----------
    path : Path
        A file, folder or archive.
    data : Path
        The benchmark folder, or the folder that holds it; it need not be there.
    protocol : str, optional
        Name or path; by default the file's own. It says which track the file is of.
    resources : Resources

    Raises
    ------
    UserError
        The file is not there or is none of its kind, or no protocol is known for it.
    """
    try:
        return _checked(open_predictions(path, None, protocol, data, resources), resources)
    except UnreadableError:
        raise
    except (PredictionError, CameraError) as error:
        return Checked([error], [])


def _checked(given: Given, resources: Resources) -> Checked:
    track, predictions, protocol = given.track, given.predictions, given.protocol
    errors = list(track.validation_errors(predictions, protocol, thorough=True))
    if errors:
        return Checked(errors, [])
    track.assign(predictions, protocol, (), given.data)
    try:
        _, truths = read_truths(track, protocol, given.data)
    except BenchmarkError as error:
        return _alone(given, resources, error)
    assigned = track.assign(predictions, protocol, truths, given.data)
    return _held(given, truths, assigned, resources)


def _alone(given: Given, resources: Resources, missing: BenchmarkError) -> Checked:
    """Find what can be found without the benchmark folder."""
    found = list(given.track.inspect_alone(given.predictions, given.protocol, resources))
    errors = [one for one in found if isinstance(one, PredictionError)]
    notes = [one for one in found if isinstance(one, str)]
    told = f"predictions were not held against the benchmark: {missing.what}"
    return Checked(errors, [*notes, told])


def _held(
    given: Given, truths: Sequence[Truth], assigned: Assigned, resources: Resources
) -> Checked:
    """Hold predictions against each scene, and go on after what is wrong."""
    track, predictions, protocol = given.track, given.predictions, given.protocol
    counts = {truth.scene: track.expected_counts(truth) for truth in truths}
    notes = [
        *namesake_notes(protocol, given.data),
        *assigned.notes(),
        *counts_apart(protocol, counts),
    ]
    errors, claims = [], []
    every = track.claims(predictions, assigned, truths, protocol, resources)
    for claim, truth in zip(every, truths, strict=True):
        if isinstance(claim, PredictionError):
            errors.append(claim)
            continue
        claims.append(claim)
        try:
            notes += track.inspect(claim, truth, protocol, resources)
        except PredictionError as error:
            errors.append(error)
    if not errors:
        notes += track.check_notes(predictions, protocol, truths, claims, resources)
    return Checked(errors, notes)
