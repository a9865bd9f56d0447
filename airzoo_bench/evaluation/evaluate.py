"""Opening predictions of any track, scoring and checking them, and making some."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.benchmark.queries import conditions_of
from airzoo_bench.core.errors import (
    BenchmarkError,
    CameraError,
    PredictionError,
    ProtocolError,
    UnreadableError,
    UsageError,
    UserError,
)
from airzoo_bench.core.files import (
    fingerprint,
    npz_fields,
    sha256_of,
    sha256_of_tree,
    temporary_folder,
)
from airzoo_bench.core.registry import READERS, TRACKS, load_track, resolve
from airzoo_bench.core.sandbox import call_limited
from airzoo_bench.core.version import versions
from airzoo_bench.evaluation.queries import check_npz
from airzoo_bench.evaluation.reader import Reading, find_reader, image_size_of, reader_named
from airzoo_bench.evaluation.run_files import SceneStore
from airzoo_bench.evaluation.track import (
    Assignment,
    Predictions,
    Run,
    ScenePredictions,
    SceneScores,
    Track,
    Truth,
)
from airzoo_bench.formats.arrays import protocol_name
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.protocol.model import (
    Protocol,
    find_protocol,
    prepared_protocols,
    protocol_files,
    protocol_of_track,
)
from airzoo_bench.results.result import (
    PredictionsUsed,
    ProtocolUsed,
    ReaderUsed,
    Result,
    ScoreColumn,
    TruthUsed,
    summarise,
)


@dataclass(frozen=True)
class ReadBy:
    """How predictions in a method's own files are to be read: see `reader.Reading`.

    The reader is found from the files where none is named; `image_size` is such as "640x480".
    """

    reader: str | None = None
    names: Path | None = None
    image_size: str | None = None


_HERE = Run()
_AS_FOUND = ReadBy()


@dataclass(frozen=True, eq=False)
class Given:
    """Predictions, opened, with their protocol.

    `reader` read a method's own files, and has `notes`; `truths` are the benchmark and its truths,
    where the reader was given them.
    """

    predictions: Predictions
    protocol: Protocol
    reader: ReaderUsed | None = None
    notes: tuple[str, ...] = ()
    truths: tuple[Benchmark, list[Truth]] | None = None

    @property
    def track(self) -> Track:
        """The track of the protocol."""
        track: Track = load_track(self.protocol.track)
        return track


def open_predictions(
    path: Path,
    *,
    data: Path,
    track: str | None = None,
    protocol: str | None = None,
    run: Run = _HERE,
    read_by: ReadBy = _AS_FOUND,
) -> Given:
    """Open predictions in this process, or in a child under limits where `run` has some."""
    if not (path.is_file() or path.is_dir()):  # or it would be waited for, or read without end
        raise UnreadableError("no such prediction file or folder", where=path, **_example())
    if run.limits is not None:
        return _open_limited(path, data, protocol, run, track=track, read_by=read_by)
    fields, stated, chosen = npz_fields(path), None, None
    if path.suffix == ".npz":  # other fields may be a method's own, which its reader opens
        stated = protocol_name(NpzFile(path, run.memory_bytes, fields - {"protocol"}))
    if protocol is not None or stated is not None:
        chosen = _choose_protocol(path, protocol, stated, track, data)
        track = chosen.track
    is_own = "query_ids" in fields or path.suffix == ".parquet" or (path / "protocol.txt").is_file()
    name = read_by.reader or (None if is_own else find_reader(path, track))
    if name is not None:
        reader = reader_named(name)
        if track not in (None, reader.track):
            what = f"is {reader.title}, predictions of the {reader.track} track, not of {track}"
            fix = f"those are scored by `airzoo-bench eval {reader.track} {path}`"
            raise UnreadableError(what, where=path, fix=fix)
        chosen = chosen or _choose_protocol(path, None, None, reader.track, data)
        return _read_native(path, name, data, chosen, run, read_by)
    track = track or _track_by_kind(path, fields)
    predictions: Predictions = load_track(track).open(path, run.memory_bytes)
    stated = predictions.protocol
    return Given(predictions, chosen or _choose_protocol(path, None, stated, track, data))


def _example() -> dict[str, str]:
    infos = [TRACKS.get(name) for name in TRACKS.names()]
    kinds = "; ".join(f"{info.name}: {info.kinds}" for info in infos)
    return {"expected": kinds, "fix": "`airzoo-bench template` writes an example"}


def _choose_protocol(
    path: Path, named: str | None, stated: str | None, track: str | None, data: Path
) -> Protocol:
    """Return the protocol that was named, else the one that predictions state."""
    if named is None and stated is None:
        there = " or ".join(prepared_protocols(str(track), data)[:3])
        raise ProtocolError(
            "does not say which protocol it is for",
            where=path,
            expected="a field 'protocol', protocol.txt in a folder or archive, or --protocol NAME",
            fix=f"add --protocol {there}" if there else "`airzoo-bench protocols` lists them",
        )
    try:
        chosen = find_protocol(named or str(stated), data)
    except ProtocolError as error:
        if named is not None:
            raise
        raise error.inside(f"{path}, field 'protocol'") from error
    if track not in (None, chosen.track):
        what = f"protocol {chosen.name} is of the {chosen.track} track, not of the {track} track"
        raise PredictionError(what, where=path, fix=f"airzoo-bench eval {chosen.track} {path}")
    return chosen


def _track_by_kind(path: Path, fields: frozenset[str]) -> str:
    """Return the track that a file's own fields, or its ending, are of."""
    infos = [TRACKS.get(name) for name in TRACKS.names()]
    for info in sorted(infos, key=lambda info: not fields & {*info.fields}):
        if info.folders if path.is_dir() else path.name.lower().endswith(info.suffixes):
            return str(info.name)
    what = f"no kind of file that predictions come in: {path.suffix[:20]!r}"
    raise UnreadableError(what, where=path, **_example())


def _read_native(
    path: Path, name: str, data: Path, chosen: Protocol, run: Run, read_by: ReadBy
) -> Given:
    """Read what a method wrote."""
    reader = reader_named(name)
    benchmark, truths = read_truths(chosen, data, sealed=True)
    reading = Reading(
        chosen,
        truths,
        read_by.names,
        run.memory_bytes,
        folders=benchmark.image_folders,
        scenes=tuple(scene.id for scene in benchmark.file.scenes),
        image_size=image_size_of(read_by.image_size),
    )
    try:
        read = reader.read(path, reading)
    except IsADirectoryError as error:
        raise UnreadableError(f"a folder, and so not {reader.title}", where=path) from error
    beside = [*read.beside, *([read_by.names] if read_by.names else [])]
    also = (f"read too: {one.name}, SHA-256 {sha256_of(one)}" for one in beside)
    used = ReaderUsed(name=name, conventions=(*read.conventions, *also))
    return Given(read.predictions, chosen, used, read.notes, (benchmark, truths))


def read_truths(
    protocol: Protocol, data: Path, *, sealed: bool = False
) -> tuple[Benchmark, list[Truth]]:
    """Find the benchmark of a protocol, and read the truth of its scenes, in its order."""
    benchmark = find_benchmark(protocol.benchmark, data, sealed=sealed)
    benchmark.check_fits(protocol)
    with benchmark.fixes():
        return benchmark, [read_truth(benchmark, protocol, one.id) for one in protocol.scenes]


def read_truth(benchmark: Benchmark, protocol: Protocol, scene: str) -> Truth:
    """Read the truth of a scene, and refuse conditions that have the name of another column."""
    track = load_track(protocol.track)
    truth: Truth = track.truth(benchmark, scene)
    taken = {*track.recorded, *(score.key for score in track.scores(protocol))}
    for name in conditions_of(truth.queries).columns if hasattr(truth, "queries") else ():
        if any(fnmatchcase(name, one) for one in taken):
            raise BenchmarkError(
                f"condition {name} has the name of a column of {protocol.track} records",
                where=benchmark.scene_folder(scene) / "queries.csv",
                fix="rename the column, then `airzoo-bench manifest FOLDER --force`",
            )
    return truth


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A result, the records it was made from, and what figures need: truths, and scored scenes."""

    result: Result
    records: pd.DataFrame
    given: Given
    benchmark: Benchmark
    truths: list[Any]
    scored: dict[str, SceneScores]

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
    given = open_predictions(
        path, data=data, track=track, protocol=protocol, run=run, read_by=read_by
    )
    chosen, known = given.protocol, given.truths
    benchmark, truths = known if known and not known[0].is_sealed else read_truths(chosen, data)
    assignment = given.track.assign(given.predictions, truths, chosen)
    for error in assignment.errors:
        raise error
    sha256, of_truths = sha256_of_tree(path), truth_fingerprint(truths)
    if store is not None:  # versions too, but not code that is being changed
        reader = None if given.reader is None else given.reader.model_dump(mode="json")
        names = None if read_by.names is None else sha256_of(read_by.names)
        inputs = [sha256, reader, names, chosen.fingerprint, of_truths, versions()]
        store.begin(fingerprint([*inputs, run.memory_bytes]))
    scored: dict[str, SceneScores] = {}
    parts = zip(truths, assignment.parts, strict=True)
    for truth, part in run.progress(parts, "scenes", len(truths)):
        scene = None if store is None else store.load(truth.scene)
        if scene is None:
            scene = given.track.score(part, truth, chosen, run)
            if store is not None:
                store.save(truth.scene, scene)
        scored[truth.scene] = scene
    scores, records = _join_records([*scored.values()], given.track.scores(chosen))
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
            fingerprint=of_truths,
            scene_titles={scene.id: scene.title for scene in chosen.scenes},
        ),
        predictions=PredictionsUsed(
            file=path.name,
            sha256=sha256,
            kind=", ".join(sorted({scene.kind for scene in scored.values() if scene.kind})),
            method=method or (path.name if path.is_dir() else path.stem),
            reader=given.reader,
        ),
        versions=dict(versions()),
        columns=tuple(scores),
        counts={name: scene.counts for name, scene in scored.items()},
        extra_queries=assignment.strange,
        notes=tuple(_notes(given, truths, assignment, [*scored.values()])),
        **asdict(summarise(records, scores, [scene.id for scene in chosen.scenes])),
        references=dict(given.track.references(chosen, truths)),
    )
    return Evaluation(result.with_checksum(), records, given, benchmark, truths, scored)


def _notes(
    given: Given, truths: Sequence[Truth], assignment: Assignment, scored: Sequence[SceneScores]
) -> list[str]:
    """Return what a reader of the scores must know, of files, scenes and all together."""
    counts = [
        f"scene {scene.title} has {one.counts['queries']:,} queries here, "
        f"{scene.queries:,} in the paper"
        for scene, one in zip(given.protocol.scenes, scored, strict=True)
        if scene.queries not in (None, one.counts.get("queries", scene.queries))
    ]
    of_scenes = [note for scene in scored for note in scene.notes]
    of_track = given.track.notes(given.predictions, truths, given.protocol, scored)
    return [*counts, *given.notes, *assignment.notes, *of_scenes, *of_track]


def _join_records(
    scored: Sequence[SceneScores], scores: list[ScoreColumn]
) -> tuple[list[ScoreColumn], pd.DataFrame]:
    """Return the scores that any scene has, and all records: the worst where a scene lacks one."""
    records = pd.concat([scene.records for scene in scored], ignore_index=True)
    scores = [score for score in scores if score.headline or score.key in records]
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
    """The errors that `evaluate` would raise, notes, and a description of the predictions."""

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
    _, truths = given.truths or read_truths(given.protocol, data, sealed=True)
    try:
        assignment = given.track.assign(given.predictions, truths, given.protocol)
    except (PredictionError, CameraError) as error:
        return Checked([error], [*given.notes], _describe(given))
    errors: list[UserError] = [*assignment.errors]
    scored = []
    for part, truth in zip(assignment.parts, truths, strict=True):
        try:  # errors of a scene hide no others
            if part is not None:
                scored.append(given.track.check(part, truth, given.protocol, run))
        except (PredictionError, CameraError) as error:
            errors.append(error)
    described = [*_describe(given), f"answers {assignment.covered}"]
    if not errors:
        return Checked([], _notes(given, truths, assignment, scored), described)
    notes = (note for one in scored for note in one.notes)
    return Checked(errors, [*given.notes, *assignment.notes, *notes], described)


def _describe(given: Given) -> list[str]:
    what = f"{given.protocol.track} predictions for {given.protocol.name}"
    if given.reader is None:
        return [what]
    reader = READERS.get(given.reader.name)
    writers = f" ({', '.join(reader.methods)})" if reader.methods else ""
    what = f"{reader.title}{writers}: {what}, read by --reader {given.reader.name}"
    return [what, *(f"taken to be so: {convention}" for convention in given.reader.conventions)]


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
    chosen = protocol_of_track(protocol, data, load_track(track).protocol)
    benchmark = find_benchmark(chosen.benchmark, data, sealed=True)
    benchmark.check_fits(chosen)
    with benchmark.fixes():
        predict = resolve(baseline.predict)
        predict(chosen, benchmark, settings or baseline.settings, out, run, note)


def write_template(
    protocol: str, *, data: Path, out: Path | None = None, kind: str | None = None, seed: int = 0
) -> tuple[Path, str]:
    """Write an example prediction for a protocol, at random; return where, and what takes it."""
    chosen = find_protocol(protocol, data)
    info = TRACKS.get(chosen.track)
    if kind is not None and kind not in info.templates:
        expected = " or ".join(info.templates) or "no --kind"
        raise UsageError(f"templates of {info.name} have no kind {kind!r}", expected=expected)
    target = out or Path("template" if info.folders else "template.npz")
    if not info.folders:
        check_npz(target)
    if target.is_file() or (target.is_dir() and any(target.iterdir())):
        what = "is there already, and could be a prediction"
        raise UsageError(what, where=target, fix="name another place with --out")
    benchmark, truths = read_truths(chosen, data, sealed=True)
    kind = kind or (*info.templates, "")[0]
    load_track(info.name).template(target, truths, chosen, kind, seed)
    return target, "check" if benchmark.is_sealed else f"eval {info.name}"


# --- predictions of strangers, which a child reads ---


@dataclass(frozen=True)
class _ListedScenes(ScenePredictions):
    """Scenes as a child lists them; another child reads each when it is opened."""

    path: Path
    protocol: str | None
    unknown_files: tuple[str, ...]
    names: tuple[str, ...]
    request: Mapping[str, Any] = field(default_factory=dict)
    run: Run | None = None

    @property
    def scenes(self) -> tuple[str, ...]:
        return self.names

    @contextmanager
    def opened(self, scene: str, *, limit_bytes: int, sampling: Any) -> Iterator[Any]:
        assert self.run is not None
        settings = {"scene": scene, "limit_bytes": limit_bytes, "sampling": sampling}
        yield _open_in_child({**self.request, **settings}, self.path, self.run)


def _open_limited(path: Path, data: Path, protocol: str | None, run: Run, **asked: Any) -> Given:
    # In a container the child does not see the folder of benchmarks, which has their truth.
    stated = protocol_files(data).get(protocol or "", protocol)
    request = {"path": path, "data": data, "protocol": stated, **asked}
    request["memory_bytes"] = run.memory_bytes
    predictions, reader, notes = _open_in_child(request, path, run)
    if isinstance(predictions, _ListedScenes):
        predictions = replace(predictions, request=request, run=run)
    chosen = find_protocol(protocol or predictions.protocol, data)
    used = None if reader is None else ReaderUsed.model_validate(reader)
    return Given(predictions, chosen, used, tuple(notes))


def _open_in_child(request: Mapping[str, Any], path: Path, run: Run) -> Any:
    """Call `open_here` in a child; its files stay for as long as the predictions."""
    assert run.limits is not None
    with ExitStack() as stack:
        parent = Path(tempfile.gettempdir())
        folder = stack.enter_context(temporary_folder(parent, "airzoo-bench"))
        place = f"{__name__}:open_here"
        found = call_limited(place, request, where=path, limits=run.limits, folder=folder)
        owner = found[0] if isinstance(found, list) else found
        weakref.finalize(owner, stack.pop_all().close)
        return found


def open_here(
    memory_bytes: int, protocol: Path | str | None, scene: str | None = None, **request: Any
) -> Any:
    """Open predictions, in the child: one scene, or all, with their reader and its notes."""
    how = {name: request.pop(name) for name in ("limit_bytes", "sampling") if name in request}
    named = None if protocol is None else str(protocol)
    given = open_predictions(run=Run(memory_bytes), protocol=named, **request)
    found: Any = given.predictions
    if scene is not None:
        return found.opened(scene, **how)
    if isinstance(found, ScenePredictions):
        listed = tuple(found.unknown_files), tuple(found.scenes)
        found = _ListedScenes(found.path, found.protocol, *listed)
    return [found, given.reader and given.reader.model_dump(mode="json"), list(given.notes)]
