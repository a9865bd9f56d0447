"""Opening predictions: finding their track, protocol and reader, and reading their truth."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, cast

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.errors import BenchmarkError, PredictionError, ProtocolError, UnreadableError
from airzoo_bench.core.files import npz_fields, sha256_of, temporary_folder
from airzoo_bench.core.registry import TRACKS, load_track
from airzoo_bench.core.sandbox import call_limited
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


def _track_by_kind(path: Path, fields: set[str]) -> str:
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


def _open_limited(path: Path, data: Path, protocol: str | None, run: Run, **asked: Any) -> Given:
    # In a container the child does not see the folder of benchmarks, which has their truth.
    stated = protocol_files(data).get(protocol or "", protocol)
    request = {"path": path, "data": data, "protocol": stated, **asked}
    request["memory_bytes"] = run.memory_bytes
    predictions, reader, notes = _call("open_here", request, path, run)
    if isinstance(predictions, _ListedScenes):
        predictions = replace(predictions, request=request, run=run)
    chosen = find_protocol(protocol or predictions.protocol, data)
    used = None if reader is None else ReaderUsed.model_validate(reader)
    return Given(predictions, chosen, used, tuple(notes))


def _call(function: str, request: Mapping[str, Any], path: Path, run: Run) -> Any:
    """Call a function of this file in a child; its files stay for as long as what it returns."""
    assert run.limits is not None
    with ExitStack() as stack:
        parent = Path(tempfile.gettempdir())
        folder = stack.enter_context(temporary_folder(parent, "airzoo-bench"))
        place = f"{__name__}:{function}"
        found = call_limited(place, request, where=path, limits=run.limits, folder=folder)
        owner = found[0] if isinstance(found, list) else found
        weakref.finalize(owner, stack.pop_all().close)
        return found


def open_here(memory_bytes: int, protocol: Path | str | None, **request: Any) -> list[Any]:
    """Open predictions, in the child; return them, their reader and its notes."""
    named = None if protocol is None else str(protocol)
    given = open_predictions(run=Run(memory_bytes), protocol=named, **request)
    found: Any = given.predictions
    if isinstance(found, ScenePredictions):
        listed = tuple(found.unknown_files), tuple(found.scenes)
        found = _ListedScenes(found.path, found.protocol, *listed)
    return [found, given.reader and given.reader.model_dump(mode="json"), list(given.notes)]


def open_scene_here(
    scene: str, limit_bytes: int, sampling: Any, memory_bytes: int, protocol: Any, **request: Any
) -> AbstractContextManager[Any]:
    """Open one scene of predictions, in the child."""
    named = None if protocol is None else str(protocol)
    given = open_predictions(run=Run(memory_bytes), protocol=named, **request)
    opened = given.predictions.opened(scene, limit_bytes=limit_bytes, sampling=sampling)
    return cast("AbstractContextManager[Any]", opened)
