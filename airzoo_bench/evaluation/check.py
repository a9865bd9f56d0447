"""Checking predictions of any track, without scoring them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

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
from airzoo_bench.evaluation.reader import find_reader
from airzoo_bench.evaluation.track import Run
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
    run: Run = Run(),  # noqa: B008 - frozen
    read_by: ReadBy = ReadBy(),  # noqa: B008 - frozen
) -> Checked:
    """Find all errors of predictions."""
    try:
        given = open_as_trusted(path, None, protocol, data, run, read_by)
    except UnreadableError:
        raise
    except (PredictionError, CameraError) as error:
        track = None if protocol is None else find_protocol(protocol, data).track
        # Who reads files that are not trusted is found in the child, which has just refused them.
        found = find_reader(path, track) if run.limits is None else None
        reader = read_by.reader or found
        return Checked([error], [], [] if reader is None else [_title(reader, "read")])
    try:
        checked = _checked(given, run)
    except (PredictionError, CameraError) as error:
        checked = Checked([error], [])
    # Of the suite's own files the errors say all; of others, who reads them comes first.
    sound = not checked.errors or given.reader is not None
    described = [*_described(given), *checked.described] if sound else []
    return replace(checked, notes=[*given.notes, *checked.notes], described=described)


def _described(given: Given) -> list[str]:
    if given.reader is None:
        return [f"{given.protocol.track} predictions for {given.protocol.name}"]
    what = f"{given.protocol.track} predictions for {given.protocol.name}, read"
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


def _checked(given: Given, run: Run) -> Checked:
    """Check the predictions of each scene, and go on after errors."""
    track, predictions, protocol = given.track, given.predictions, given.protocol
    notes: list[str] = []
    truths: list[Any] = []
    try:
        truths = read_truths(protocol, given.data, sealed=True)[1]
    except BenchmarkError as error:
        notes.append(f"predictions were not compared with the benchmark: {error.what}")
    assignment = track.assign(predictions, truths, protocol)
    errors: list[UserError] = list(assignment.errors)
    scored = []
    known = truths or [None] * len(protocol.scenes)
    for part, truth in zip(assignment.parts, known, strict=False):
        if part is not None:
            try:
                scored.append(track.check(part, truth, protocol, run))
            except PredictionError as error:
                errors.append(error)
    if truths:
        notes += [*namesake_notes(protocol, given.data), *assignment.notes]
    notes += [note for scene in scored for note in scene.notes]
    if truths and not errors:
        scenes = zip(protocol.scenes, scored, strict=True)
        notes += counts_apart(protocol, {scene.id: one.counts for scene, one in scenes})
        notes += track.notes(predictions, truths, protocol, scored)
    return Checked(errors, notes, [f"answers {assignment.covered}"] if truths else [])
