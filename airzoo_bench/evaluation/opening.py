"""Opening predictions: finding their track, protocol and reader, and reading their truth."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.errors import BenchmarkError, PredictionError, ProtocolError, UnreadableError
from airzoo_bench.core.files import npz_fields, sha256_of, temporary_folder
from airzoo_bench.core.registry import TRACKS, load_track
from airzoo_bench.core.sandbox import call_limited, check_limits
from airzoo_bench.evaluation.reader import Reading, find_reader, image_size_of, reader_named
from airzoo_bench.evaluation.track import Predictions, Run, ScenePredictions, Track, Truth
from airzoo_bench.formats.arrays import protocol_name
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.protocol.model import Protocol, find_protocol, prepared_protocols, protocol_files
from airzoo_bench.results.result import ReaderUsed


@dataclass(frozen=True)
class ReadBy:
    """How predictions in a method's own files are to be read: see `reader.Reading`.

    The reader is found from the files where none is named; `image_size` is such as "640x480".
    """

    reader: str | None = None
    names: Path | None = None
    image_size: str | None = None


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
    run: Run = Run(),  # noqa: B008 - frozen
    read_by: ReadBy = ReadBy(),
) -> Given:
    """Open predictions in this process, or in a child under limits where `run` has some."""
    infos = {name: TRACKS.get(name) for name in TRACKS.names()}
    kinds = "; ".join(f"{name}: {info.kinds}" for name, info in infos.items())
    example = {"expected": kinds, "fix": "`airzoo-bench template` writes an example"}
    if not (path.is_file() or path.is_dir()):  # or it would be waited for, or read without end
        raise UnreadableError("no such prediction file or folder", where=path, **example)
    if run.limits is not None:
        return _open_limited(path, data, protocol, run, track=track, read_by=read_by)
    fields, chosen = npz_fields(path), None
    others = fields - {"protocol"}  # they may be a method's own, which its reader opens
    is_npz = path.suffix == ".npz"
    stated = protocol_name(NpzFile(path, run.memory_bytes, others)) if is_npz else None
    if protocol is not None or stated is not None:
        chosen = _stated_protocol(path, protocol, stated, data)
        track = _checked_track(path, chosen, track)
    is_own = "query_ids" in fields or path.suffix == ".parquet" or (path / "protocol.txt").is_file()
    name = read_by.reader or (None if is_own else find_reader(path, track))
    if name is not None:
        return _open_native(path, name, data, track, chosen, run, read_by)
    if track is None:
        kind, is_folder = path.name.lower(), path.is_dir()
        fitting = [
            one.name
            for one in sorted(infos.values(), key=lambda info: not fields & {*info.fields})
            if (one.folders if is_folder else kind.endswith(one.suffixes))
        ]
        if not fitting:
            what = f"no kind of file that predictions come in: {path.suffix[:20]!r}"
            raise UnreadableError(what, where=path, **example)
        track = fitting[0]
    predictions: Predictions = load_track(track).open(path, run.memory_bytes)
    if chosen is None:
        chosen = _stated_protocol(path, None, predictions.protocol, data)
        _checked_track(path, chosen, track)
    return Given(predictions, chosen)


def _stated_protocol(path: Path, named: str | None, in_file: str | None, data: Path) -> Protocol:
    """Return the protocol that was named, else the one that predictions state."""
    if named is not None:
        return find_protocol(named, data)
    if in_file is None:
        raise ProtocolError(
            "does not say which protocol it is for",
            where=path,
            expected="a field 'protocol' in the file, or protocol.txt in the folder or archive",
            fix="name it with --protocol; `airzoo-bench protocols` lists them",
        )
    try:
        return find_protocol(in_file, data)
    except ProtocolError as error:
        raise error.inside(f"{path}, field 'protocol'") from error


def _checked_track(path: Path, chosen: Protocol, track: str | None) -> str:
    """Return the track of a protocol, which must be the one that is asked for, if one is."""
    if track not in (None, chosen.track):
        raise PredictionError(
            f"protocol {chosen.name} is of the {chosen.track} track, not of the {track} track",
            where=path,
            fix=f"airzoo-bench eval {chosen.track} {path}",
        )
    return chosen.track


def _open_native(
    path: Path,
    name: str,
    data: Path,
    track: str | None,
    chosen: Protocol | None,
    run: Run,
    read_by: ReadBy,
) -> Given:
    """Read what a method wrote; such files do not say which protocol they are for."""
    reader = reader_named(name)
    if track not in (None, reader.track):
        raise UnreadableError(
            f"is {reader.title}, predictions of the {reader.track} track, not of the {track} track",
            where=path,
            fix=f"those are scored by `airzoo-bench eval {reader.track} {path}`",
        )
    if chosen is None:
        there = " or ".join(prepared_protocols(reader.track, data)[:3])
        raise ProtocolError(
            "does not say which protocol it is for",
            where=path,
            expected=f"--protocol NAME, for what was read as {reader.title}",
            fix=f"add --protocol {there}" if there else "`airzoo-bench protocols` lists them",
        )
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
    conditions = getattr(truth, "conditions", None)  # of queries; other tracks have none
    taken = {*track.recorded, *(score.key for score in track.scores(protocol))}
    for name in [] if conditions is None else map(str, conditions.columns):
        if any(fnmatchcase(name, one) for one in taken):
            raise BenchmarkError(
                f"condition {name} has the name of a column of {protocol.track} records",
                where=benchmark.scene_folder(scene) / "queries.csv",
                fix="rename the column, then `airzoo-bench manifest FOLDER --force`",
            )
    return truth


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
        settings = {"scene": scene, "limit_bytes": limit_bytes, "sampling": sampling}
        assert self.run is not None
        yield _call("open_scene_here", {**self.request, **settings}, self.path, self.run)


@dataclass(frozen=True)
class _Opened:
    predictions: Any
    reader: dict[str, Any] | None
    notes: tuple[str, ...]


def _open_limited(path: Path, data: Path, protocol: str | None, run: Run, **asked: Any) -> Given:
    check_limits()
    # In a container the child does not see the folder of benchmarks, which has their truth.
    stated = protocol_files(data).get(protocol or "", protocol)
    request = {"path": path, "data": data, "protocol": stated, **asked}
    request["memory_bytes"] = run.memory_bytes
    found = _call("open_here", request, path, run)
    predictions = found.predictions
    if isinstance(predictions, _ListedScenes):
        predictions = replace(predictions, request=request, run=run)
    chosen = find_protocol(protocol or predictions.protocol, data)
    reader = ReaderUsed.model_validate(found.reader) if found.reader else None
    return Given(predictions, chosen, reader, tuple(found.notes))


def _call(function: str, request: Mapping[str, Any], path: Path, run: Run) -> Any:
    """Call a function of this file in a child; its files stay for as long as what it returns."""
    assert run.limits is not None
    with ExitStack() as stack:
        parent = Path(tempfile.gettempdir())
        folder = stack.enter_context(temporary_folder(parent, "airzoo-bench"))
        place = f"{__name__}:{function}"
        found = call_limited(place, request, where=path, limits=run.limits, folder=folder)
        weakref.finalize(getattr(found, "predictions", found), stack.pop_all().close)
        return found


def _given_here(memory_bytes: int, protocol: Path | str | None, **request: Any) -> Given:
    named = None if protocol is None else str(protocol)
    return open_predictions(run=Run(memory_bytes), protocol=named, **request)


def open_here(**request: Any) -> _Opened:
    """Open predictions, in the child."""
    given = _given_here(**request)
    found: Any = given.predictions
    if isinstance(found, ScenePredictions):
        listed = tuple(found.unknown_files), tuple(found.scenes)
        found = _ListedScenes(found.path, found.protocol, *listed)
    reader = given.reader.model_dump(mode="json") if given.reader else None
    return _Opened(found, reader, given.notes)


def open_scene_here(
    scene: str, limit_bytes: int, sampling: Any, **request: Any
) -> AbstractContextManager[Any]:
    """Open one scene of predictions, in the child."""
    predictions: Any = _given_here(**request).predictions
    opened: AbstractContextManager[Any] = predictions.opened(
        scene, limit_bytes=limit_bytes, sampling=sampling
    )
    return opened
