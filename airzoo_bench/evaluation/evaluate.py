"""Scoring, checking and making predictions of any track."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.errors import (
    CameraError,
    PredictionError,
    ProtocolError,
    UnreadableError,
    UsageError,
    UserError,
    agreeing,
    first_of,
)
from airzoo_bench.core.files import fingerprint, sha256_of, sha256_of_tree
from airzoo_bench.core.registry import READERS, TRACKS, load_track, resolve
from airzoo_bench.core.version import versions
from airzoo_bench.evaluation.info import TrackInfo
from airzoo_bench.evaluation.opening import Given, ReadBy, open_predictions, read_truths
from airzoo_bench.evaluation.queries import check_npz
from airzoo_bench.evaluation.run_files import SceneStore
from airzoo_bench.evaluation.track import Assignment, Run, Scored, Truth
from airzoo_bench.protocol.model import (
    Protocol,
    find_protocol,
    load_protocol,
    protocol_files,
    protocol_of_track,
)
from airzoo_bench.results.comparable import other_settings
from airzoo_bench.results.result import (
    PredictionsUsed,
    ProtocolUsed,
    Result,
    ScoreColumn,
    TruthUsed,
    summarise,
)

FACTOR = 3.0
"""Errors of method and truth add as squares: a truth that is wrong by a third of a threshold makes
an error there larger by 5 % (the root of 1 + 1/9); one that is wrong by half of it, by 12 %."""

# Settings that hold lengths in metres, by which predictions pass or fail.
_THRESHOLDS = (
    *("distance_below_m", "translation_below_m", "pose_below_m_deg", "auc_up_to_m"),
    *("f1_below_m", "headline_below_m"),
)
_HERE = Run()
_AS_FOUND = ReadBy()


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A result, the records it was made from, and what figures need: truths, and scored scenes."""

    result: Result
    records: pd.DataFrame
    given: Given
    benchmark: Benchmark
    truths: list[Any]
    scored: dict[str, Scored]

    @property
    def protocol(self) -> Any:
        """The protocol, of its track's own class."""
        return self.given.protocol


def evaluate(
    path: Path,
    *,
    data: Path,
    track: str | None = None,
    protocol: str | None = None,
    method: str | None = None,
    run: Run = _HERE,
    read_by: ReadBy = _AS_FOUND,
    store: SceneStore | None = None,
) -> Evaluation:
    """Score predictions."""
    asked = {"track": track, "protocol": protocol}
    given = open_predictions(path, data=data, run=run, read_by=read_by, **asked)
    chosen, known = given.protocol, given.truths
    benchmark, truths = known if known and not known[0].is_sealed else read_truths(chosen, data)
    assignment = given.track.assign(given.predictions, truths, chosen)
    for error in assignment.errors:
        raise error
    sha256 = sha256_of_tree(path)
    if store is not None:
        store.begin(_run_fingerprint(given, sha256, truths, read_by, run))
    scored: dict[str, Scored] = {}
    parts = zip(truths, assignment.parts, strict=True)
    for truth, part in run.progress(parts, "scenes", len(truths)):
        scene = None if store is None else store.load(truth.scene)
        if scene is None:
            scene = given.track.score(part, truth, chosen, run)
            if store is not None:
                store.save(truth.scene, scene)
        scored[truth.scene] = scene
    scores, records = _join_records([*scored.values()], given.track.scores(chosen))
    used = PredictionsUsed(
        file=path.name,
        sha256=sha256,
        kind=", ".join(sorted({scene.kind for scene in scored.values() if scene.kind})),
        method=method or (path.name if path.is_dir() else path.stem),
        reader=given.reader,
    )
    result = Result(
        track=chosen.track,
        protocol=ProtocolUsed(
            name=chosen.name,
            version=chosen.version,
            fingerprint=chosen.fingerprint,
            settings=chosen.settings(),
        ),
        truth=TruthUsed(
            benchmark=benchmark.name,
            version=benchmark.file.version,
            fingerprint=truth_fingerprint(truths),
            scene_titles={scene.id: scene.title for scene in chosen.scenes},
        ),
        predictions=used,
        versions=dict(versions()),
        columns=tuple(scores),
        counts={name: scene.counts for name, scene in scored.items()},
        extra_queries=assignment.strange,
        notes=_notes(given, benchmark, truths, assignment, [*scored.values()]),
        **asdict(summarise(records, scores, [scene.id for scene in chosen.scenes])),
        references=dict(given.track.references(chosen, truths)),
    )
    return Evaluation(result.with_checksum(), records, given, benchmark, truths, scored)


def _notes(
    given: Given,
    benchmark: Benchmark,
    truths: Sequence[Truth],
    assignment: Assignment,
    scored: Sequence[Scored],
) -> tuple[str, ...]:
    accuracy = {scene.id: scene.truth_accuracy_m for scene in benchmark.file.scenes}
    return (
        *_namesake_notes(given.protocol, benchmark.folder),
        *_count_notes(given.protocol, scored),
        *accuracy_notes(given.protocol, accuracy),
        *given.notes,
        *assignment.notes,
        *(note for scene in scored for note in scene.notes),
        *given.track.notes(given.predictions, truths, given.protocol, scored),
    )


def _run_fingerprint(
    given: Given, sha256: str, truths: Sequence[Truth], read_by: ReadBy, run: Run
) -> str:
    """Return a fingerprint of the inputs and versions, but not of code that is being changed."""
    reader = None if given.reader is None else given.reader.model_dump(mode="json")
    names = None if read_by.names is None else sha256_of(read_by.names)
    parts = sha256, reader, names, given.protocol.fingerprint, truth_fingerprint(truths)
    return fingerprint([*parts, versions(), run.memory_bytes])


def _join_records(
    scored: Sequence[Scored], scores: list[ScoreColumn]
) -> tuple[list[ScoreColumn], pd.DataFrame]:
    """Return the scores that any scene has, and all records: the worst where a scene lacks one."""
    records = pd.concat([scene.records for scene in scored], ignore_index=True)
    for score in (one for one in scores if one.headline and one.key not in records):
        raise ValueError(f"no record has the headline {score.key}, by a fault of the track")
    scores = [score for score in scores if score.key in records]
    lacking = {
        score.key: 0.0 if score.higher_is_better else np.inf
        for score in scores
        if not all(score.key in scene.records for scene in scored)
    }
    return scores, records.fillna(lacking) if lacking else records


def truth_fingerprint(truths: Sequence[Truth]) -> str:
    """Return the SHA-256 over all that scores of some scenes depend on."""
    return fingerprint({truth.scene: truth.fingerprint for truth in truths})


@dataclass(frozen=True)
class Checked:
    """The errors and notes of predictions.

    `errors` are what `evaluate` would raise; `described` says what the files are, what reads them
    and how much of the benchmark they answer.
    """

    errors: list[UserError]
    notes: list[str] = field(default_factory=list)
    described: list[str] = field(default_factory=list)


def check(
    path: Path,
    *,
    data: Path,
    protocol: str | None = None,
    run: Run = _HERE,
    read_by: ReadBy = _AS_FOUND,
) -> Checked:
    """Find errors of predictions, the first in each file or scene, without scoring them.

    The benchmark folder may be one whose truth is sealed.
    """
    try:
        given = open_predictions(path, data=data, protocol=protocol, run=run, read_by=read_by)
    except UnreadableError:
        raise
    except (PredictionError, CameraError) as error:
        return Checked([error])
    described = [f"{given.protocol.track} predictions for {given.protocol.name}"]
    if given.reader is not None:
        reader = READERS.get(given.reader.name)
        writers = f" ({', '.join(reader.methods)})" if reader.methods else ""
        described = [
            f"{reader.title}{writers}: {described[0]}, read by --reader {given.reader.name}",
            *(f"taken to be so: {convention}" for convention in given.reader.conventions),
        ]
    _, truths = given.truths or read_truths(given.protocol, data, sealed=True)
    try:
        errors, notes, covered = _check_scenes(given, truths, data, run)
    except (PredictionError, CameraError) as error:
        errors, notes, covered = [error], [], []
    # Of the suite's own files the errors say all; of others, who reads them comes first.
    described = [] if errors and given.reader is None else [*described, *covered]
    return Checked(errors, [*given.notes, *notes], described)


def _check_scenes(
    given: Given, truths: Sequence[Truth], data: Path, run: Run
) -> tuple[list[UserError], list[str], list[str]]:
    """Return errors, notes, and how much is answered; errors of a scene hide no others."""
    track, protocol = given.track, given.protocol
    assignment = track.assign(given.predictions, truths, protocol)
    errors: list[UserError] = [*assignment.errors]
    scored = []
    for part, truth in zip(assignment.parts, truths, strict=True):
        try:
            if part is not None:
                scored.append(track.check(part, truth, protocol, run))
        except PredictionError as error:
            errors.append(error)
    notes = [note for scene in scored for note in scene.notes]
    notes += [*_namesake_notes(protocol, data), *assignment.notes]
    if not errors:
        notes += _count_notes(protocol, scored)
        notes += track.notes(given.predictions, truths, protocol, scored)
    return errors, notes, [f"answers {assignment.covered}"]


def _namesake_notes(used: Protocol, data: Path) -> list[str]:
    """Note a protocol that has the name of a known one and measures something else."""
    path = protocol_files(data).get(used.name)
    try:
        known = None if path is None else load_protocol(path)
    except ProtocolError:  # a protocol that cannot be used is no namesake
        known = None
    if known is None or known.fingerprint == used.fingerprint:
        return []
    why = other_settings(known.settings(), used.settings())
    return [f"the protocol is not the {used.name} that all have: {why}"]


def _count_notes(protocol: Protocol, scored: Sequence[Scored]) -> list[str]:
    """Name scenes with more or fewer queries than in the paper."""
    return [
        f"scene {scene.title} has {one.counts['queries']:,} queries here, "
        f"{scene.queries:,} in the paper"
        for scene, one in zip(protocol.scenes, scored, strict=True)
        if scene.queries not in (None, one.counts.get("queries", scene.queries))
    ]


def accuracy_notes(protocol: Protocol, accuracy_m: Mapping[str, float | None]) -> list[str]:
    """Say which thresholds are finer than three times the stated accuracy of the truth."""
    stated = {one.id: m for one in protocol.scenes if (m := accuracy_m.get(one.id)) is not None}
    worst = max(stated.values(), default=0.0)
    fine = sorted({m for m in _lengths(protocol.settings()) if m < FACTOR * worst})
    if not fine:
        return []
    scenes = first_of([name for name, m in stated.items() if FACTOR * m > fine[0]], noun="scene")
    return [
        f"the truth of {scenes} is stated to be good to {worst:g} m: below {FACTOR:g} times that, "
        f"{agreeing(len(fine), 'the threshold', 'the thresholds')} "
        f"{', '.join(f'{m:g}' for m in fine)} m of {protocol.name} "
        f"{agreeing(len(fine), 'measures', 'measure')} errors of the truth too"
    ]


def _lengths(settings: Mapping[str, Any]) -> Iterator[float]:
    """Yield the metres of all thresholds."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from _lengths(value)
        elif key in _THRESHOLDS:
            for one in value if isinstance(value, list) else [value]:
                yield float(one[0] if isinstance(one, list) else one)


def run_baseline(
    track: str,
    protocol: str,
    out: Path,
    *,
    data: Path,
    settings: Any = None,
    run: Run = _HERE,
    note: Callable[[str], None] = lambda _: None,
) -> None:
    """Run a track's baseline on a benchmark and write predictions."""
    baseline = TRACKS.get(track).baseline
    if baseline is None:
        raise UsageError(f"the {track} track has no baseline")
    chosen = protocol_of_track(protocol, data, load_track(track).protocol)
    benchmark = find_benchmark(chosen.benchmark, data, sealed=True)
    benchmark.check_fits(chosen)
    with benchmark.fixes():
        predict = resolve(baseline.predict)
        predict(chosen, benchmark, settings or baseline.settings, out, run, note)


@dataclass(frozen=True)
class Template:
    """An example that was written; `note` says what it will score, if known and not `sealed`."""

    track: str
    out: Path
    note: str | None
    sealed: bool = False


def write_template(
    protocol: str, *, data: Path, out: Path | None = None, kind: str | None = None, seed: int = 0
) -> Template:
    """Write an example prediction for a protocol, at random."""
    chosen = find_protocol(protocol, data)
    info: TrackInfo = TRACKS.get(chosen.track)
    if kind is not None and kind not in info.templates:
        raise UsageError(
            f"templates of {info.name} have no kind {kind!r}",
            expected=" or ".join(info.templates) or "no --kind",
        )
    target = out or Path("template" if info.folders else "template.npz")
    if not info.folders:
        check_npz(target)
    if target.is_file() or (target.is_dir() and any(target.iterdir())):
        what = "is there already, and could be a prediction"
        raise UsageError(what, where=target, fix="name another place with --out")
    benchmark, truths = read_truths(chosen, data, sealed=True)
    kind = kind or (*info.templates, "")[0]
    note = load_track(info.name).template(target, truths, chosen, kind, seed)
    return Template(info.name, target, note, benchmark.is_sealed)
