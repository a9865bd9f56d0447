"""Checking predictions of any track, without scoring them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from airzoo_bench.core.errors import (
    BenchmarkError,
    CameraError,
    PredictionError,
    UnreadableError,
    UserError,
)
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.evaluate import counts_apart, namesake_notes
from airzoo_bench.evaluation.given import Given, ReadBy, read_truths
from airzoo_bench.evaluation.parts import Assigned, Resources, Truth
from airzoo_bench.evaluation.reader import find_reader
from airzoo_bench.evaluation.untrusted import open_as_trusted
from airzoo_bench.protocol.lookup import find_protocol

__all__ = ["Checked", "check"]


@dataclass(frozen=True)
class Checked:
    """What a check found.

    Attributes
    ----------
    errors : sequence of UserError
        What `evaluate` would raise.
    notes : list of str
    described : list of str
        What the files are, what reads them and how much of the benchmark they answer, as far as
        that could be told.
    """

    errors: Sequence[UserError]
    notes: list[str]
    described: list[str] = field(default_factory=list)


def check(
    path: Path,
    *,
    data: Path,
    protocol: str | None = None,
    resources: Resources = Resources(),  # noqa: B008 - frozen
    read_by: ReadBy = ReadBy(),  # noqa: B008 - frozen
) -> Checked:
    """Find all errors of predictions."""
    try:
        given = open_as_trusted(path, None, protocol, data, resources, read_by)
    except UnreadableError:
        raise
    except (PredictionError, CameraError) as error:
        track = None if protocol is None else find_protocol(protocol, data).track
        # Who reads files that are not trusted is found in the child, which has just refused them.
        found = find_reader(path, track) if resources.limits is None else None
        reader = read_by.reader or found
        return Checked([error], [], [] if reader is None else [_title(reader, "read")])
    try:
        checked = _checked(given, resources)
    except (PredictionError, CameraError) as error:
        checked = Checked([error], [])
    # Of the suite's own files the errors say all; of others, who reads them comes first.
    sound = not checked.errors or given.reader is not None
    described = [*_described(given), *checked.described] if sound else []
    return replace(checked, notes=[*given.notes, *checked.notes], described=described)


def _described(given: Given) -> list[str]:
    if given.reader is None:
        return [f"{given.track.name} predictions for {given.protocol.name}"]
    what = f"{given.track.name} predictions for {given.protocol.name}, read"
    return [
        _title(given.reader.name, what),
        *(f"taken to be so: {convention}" for convention in given.reader.conventions),
    ]


def _title(name: str, what: str) -> str:
    """Say what files are that a reader takes for its own, who writes them and what reads them."""
    reader = READERS.get(name)
    verb = "writes" if len(reader.methods) == 1 else "write"
    written = f", as {', '.join(reader.methods)} {verb} it" if reader.methods else ""
    return f"{reader.title}{written}: {what} by --reader {name}"


def _checked(given: Given, resources: Resources) -> Checked:
    track, predictions, protocol = given.track, given.predictions, given.protocol
    errors = list(track.validation_errors(predictions, protocol, thorough=True))
    if errors:
        return Checked(errors, [])
    try:
        _, truths = read_truths(track, protocol, given.data, sealed=True)
    except BenchmarkError as error:
        track.assign(predictions, protocol, (), given.data)
        return _without_benchmark(given, resources, error)
    assigned = track.assign(predictions, protocol, truths, given.data)
    return _with_benchmark(given, truths, assigned, resources)


def _without_benchmark(given: Given, resources: Resources, missing: BenchmarkError) -> Checked:
    """Find what can be found without the benchmark folder."""
    found = list(given.track.inspect_alone(given.predictions, given.protocol, resources))
    errors = [one for one in found if isinstance(one, PredictionError)]
    notes = [one for one in found if isinstance(one, str)]
    unmatched = f"predictions were not compared with the benchmark: {missing.what}"
    return Checked(errors, [*notes, unmatched])


def _with_benchmark(
    given: Given, truths: Sequence[Truth], assigned: Assigned, resources: Resources
) -> Checked:
    """Check the predictions of each scene, and go on after errors."""
    track, predictions, protocol = given.track, given.predictions, given.protocol
    counts = {truth.scene: track.expected_counts(truth) for truth in truths}
    notes = [
        *namesake_notes(protocol, given.data),
        *assigned.notes(),
        *counts_apart(protocol, counts),
    ]
    errors, scene_predictions = [], []
    matched = track.match(predictions, assigned, truths, protocol, resources)
    for predicted, truth in zip(matched, truths, strict=True):
        if isinstance(predicted, PredictionError):
            errors.append(predicted)
            continue
        scene_predictions.append(predicted)
        try:
            notes += track.inspect(predicted, truth, protocol, resources)
        except PredictionError as error:
            errors.append(error)
    if not errors:
        notes += track.check_notes(predictions, protocol, truths, scene_predictions, resources)
    return Checked(errors, notes, [f"answers {assigned.covered}"])
