"""Predictions: opened in the suite's own layout, or as a reader reads a method's own files."""

from __future__ import annotations

import re
import tempfile
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.benchmark.queries import conditions_of
from airzoo_bench.core.errors import (
    BenchmarkError,
    PredictionError,
    ProtocolError,
    UnreadableError,
    UsageError,
    counted,
    first_of,
)
from airzoo_bench.core.files import (
    atomic_write,
    npz_fields,
    sha256_of,
    temporary_folder,
    write_npz,
)
from airzoo_bench.core.ids import rows_among
from airzoo_bench.core.registry import READERS, TRACKS, load_track
from airzoo_bench.core.sandbox import call_limited
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.track import (
    Assignment,
    Predictions,
    Run,
    ScenePredictions,
    Track,
    Truth,
)
from airzoo_bench.formats.arrays import Arrays, check_fields, protocol_name, texts
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.protocol.model import (
    Protocol,
    find_protocol,
    prepared_protocols,
    protocol_files,
)
from airzoo_bench.results.result import ReaderUsed

C = TypeVar("C")

SURE = 0.5
"""A reader that is less sure than this does not take a path for its own."""

_SURE_OF_TRACK = 0.25  # the same where its track is the one that is asked for
_SHOWN = 3
_SHOWN_LETTERS = 80


# --- predictions with a row a query, of all scenes in one file ---


@dataclass(frozen=True, eq=False)
class QueryPredictions(Generic[C]):
    """A prediction file with a row a query: N ids ``scene/name``, and the predicted `content`."""

    path: Path
    protocol: str | None
    query_ids: NDArray[np.str_]
    content: C


class QueryPart(NamedTuple):
    """The predictions of all scenes, and the row of each query of one scene, -1 for none."""

    predictions: Any
    rows: NDArray[np.intp]


def assign_queries(
    predictions: QueryPredictions[Any], truths: Sequence[Any], protocol: Protocol
) -> Assignment:
    """Find the row that answers each query."""
    ids, notes = predictions.query_ids, []
    wanted = [truth.queries["id"].to_numpy(str) for truth in truths]
    asked = np.concatenate(wanted)
    found = rows_among(asked, ids)
    if (found < 0).all():
        raise PredictionError(
            f"none of its query ids belongs to {protocol.benchmark}: {first_of(ids, len(ids))}",
            where=f"{predictions.path}, field 'query_ids'",
            expected=f"ids such as {asked[0]}: scenes as the protocol has them, no file's ending",
            fix="name the right protocol with --protocol; `airzoo-bench template` writes the ids",
        )
    missing, strange = asked[found < 0], np.delete(ids, found[found >= 0])
    ends = np.cumsum([len(some) for some in wanted])[:-1]
    parts = [QueryPart(predictions, rows) for rows in np.split(found, ends)]
    if missing.size:
        named = first_of(missing, len(asked), _SHOWN)
        notes.append(f"queries that the predictions lack, scored at their worst: {named}")
    if strange.size:
        shown = [
            repr(name[:_SHOWN_LETTERS]) + nearest(name, missing.tolist(), 1)
            for name in strange[:_SHOWN].tolist()
        ]
        named = first_of([*shown, *strange[_SHOWN:]], shown=_SHOWN)
        notes.append(f"ids of the predictions that are no queries, left aside: {named}")
    covered = f"{len(asked) - len(missing):,} of {counted(len(asked), 'query')}"
    return Assignment(parts, covered, notes, len(strange))


class Fields(NamedTuple, Generic[C]):
    """A form that predictions of a track can have; a file with the field `marker` has this form.

    `needed` and `optional` are fields besides ``query_ids`` and ``protocol``; `read` takes the
    file's arrays and its query ids.
    """

    marker: str
    needed: tuple[str, ...]
    optional: tuple[str, ...]
    read: Callable[[Arrays, NDArray[np.str_]], C]


def read_fields(arrays: Arrays, forms: tuple[Fields[C], ...], expected: str) -> QueryPredictions[C]:
    """Read predictions in the one form that a file has."""
    found = [form for form in forms if form.marker in arrays.names()]
    if len(found) > 1:
        what = f"holds {' and '.join(form.marker for form in found)}, and they could disagree"
        raise PredictionError(what, where=arrays.path, expected=expected, fix="keep one of them")
    form = (*found, forms[0])[0]
    allowed = ("protocol", "query_ids", *form.needed, *form.optional)
    check_fields(arrays, ("query_ids", *form.needed), allowed, expected)
    ids = texts(arrays, "query_ids", 1)
    return QueryPredictions(arrays.path, protocol_name(arrays), ids, form.read(arrays, ids))


def check_npz(out: Path) -> None:
    """Refuse, before any work, an output name that does not end in ``.npz``."""
    if out.suffix != ".npz":
        raise UsageError("predictions are written as .npz", where=out, fix=f"name it {out}.npz")


def write_predictions(out: Path, protocol: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write the arrays of predictions and the name of their protocol as one ``.npz``."""
    with atomic_write(out) as stream:
        write_npz(stream, {"protocol": np.array(protocol), **arrays})


# --- readers of the files that methods write ---


@dataclass(frozen=True, eq=False)
class Reading:
    """The input of a reader besides the path.

    `truths` are those of the protocol's scenes, perhaps sealed: readers take names of queries,
    tiles and photos from them, and nothing else. `names` is a list of image names, a line each, in
    the order in which the method saw them; `image_size` that of the pictures that a matcher was
    given, for files that do not state it. Predictions may name any folder of the computer: only
    what lies in `folders`, or below the predictions, may be listed for them. `scenes` are those of
    the benchmark, also without the protocol: a path that names one of them is of no other.
    """

    protocol: Protocol
    truths: Sequence[Any]
    names: Path | None
    memory_bytes: int
    folders: tuple[Path, ...] = ()
    scenes: tuple[str, ...] = ()
    image_size: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class ReadPredictions:
    """Predictions as a reader has read them.

    `conventions` say for the result what was taken to be so: pixel centres, axes, quaternions.
    `beside` are the files read besides the path; the result states their checksums.
    """

    predictions: Predictions
    conventions: tuple[str, ...]
    notes: tuple[str, ...] = ()
    beside: tuple[Path, ...] = ()


class Reader(ABC):
    """Reads what one method, or a family of methods, writes, into predictions of a track.

    `title` names the files for people, such as "descriptors of VPR-methods-evaluation", `layout`
    says how they are recognised, `methods` who writes them.
    """

    track: ClassVar[str]
    title: str
    layout: str
    methods: tuple[str, ...] = ()

    @abstractmethod
    def recognise(self, path: Path) -> float:
        """Return from 0 to 1 how sure it is that a path is its own, by the content of the files."""

    @abstractmethod
    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """Read a path into predictions."""


def reader_named(name: str) -> Reader:
    """Return the reader of a name."""
    names = READERS.names()
    if name not in names:
        what = f"there is no reader {name[:80]!r}{nearest(name[:80], names)}"
        raise UsageError(what, where="--reader", expected="one of " + ", ".join(names))
    found: Reader = READERS.get(name)
    return found


def find_reader(path: Path, track: str | None = None) -> str | None:
    """Return the name of the reader that recognises a path, if one does."""
    readers = {name: reader_named(name) for name in READERS.names()}
    of_track = [name for name, one in readers.items() if one.track == track]
    most: list[str] = []
    for names, least in ((of_track, _SURE_OF_TRACK), (readers, SURE)):
        if not most:
            sure = {name: readers[name].recognise(path) for name in names}
            best = max([least, *sure.values()])
            most = [name for name, value in sure.items() if value == best]
    if len(most) > 1:
        raise UnreadableError(
            f"could be {' or '.join(readers[name].title for name in most)}",
            where=path,
            fix=f"say which: {' or '.join(f'--reader {name}' for name in most)}",
        )
    return most[0] if most else None


# --- opening ---


@dataclass(frozen=True)
class ReaderOptions:
    """How predictions in a method's own files are to be read: see `Reading`.

    The reader is found from the files where none is named; `image_size` is such as "640x480".
    """

    reader: str | None = None
    names: Path | None = None
    image_size: str | None = None


HERE, AS_FOUND = Run(), ReaderOptions()


@dataclass(frozen=True, eq=False)
class OpenedPredictions:
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
    run: Run = HERE,
    read_by: ReaderOptions = AS_FOUND,
) -> OpenedPredictions:
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
    return OpenedPredictions(
        predictions, chosen or _choose_protocol(path, None, stated, track, data)
    )


def _example() -> dict[str, str]:
    kinds = "; ".join(f"{name}: {TRACKS.get(name).kinds}" for name in TRACKS.names())
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
    """Return the track of a file's own fields, or of its ending."""
    infos = [TRACKS.get(name) for name in TRACKS.names()]
    for info in sorted(infos, key=lambda info: not fields & {*info.fields}):
        if info.folders if path.is_dir() else path.name.lower().endswith(info.suffixes):
            return str(info.name)
    what = f"no kind of file that predictions come in: {path.suffix[:20]!r}"
    raise UnreadableError(what, where=path, **_example())


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


def _read_native(
    path: Path, name: str, data: Path, chosen: Protocol, run: Run, read_by: ReaderOptions
) -> OpenedPredictions:
    """Read what a method wrote."""
    reader, size = reader_named(name), None
    if read_by.image_size is not None:
        size = re.fullmatch(r"([1-9]\d{0,5})x([1-9]\d{0,5})", read_by.image_size)
        if size is None:
            what = f"{read_by.image_size[:40]!r} is no size of a picture"
            expected = "width and height, as 640x480"
            raise UsageError(what, where="--image-size", expected=expected)
    benchmark, truths = read_truths(chosen, data, sealed=True)
    reading = Reading(
        chosen,
        truths,
        read_by.names,
        run.memory_bytes,
        folders=benchmark.image_folders,
        scenes=tuple(scene.id for scene in benchmark.file.scenes),
        image_size=None if size is None else (float(size[1]), float(size[2])),
    )
    try:
        read = reader.read(path, reading)
    except IsADirectoryError as error:
        raise UnreadableError(f"a folder, and so not {reader.title}", where=path) from error
    beside = [*read.beside, *([read_by.names] if read_by.names else [])]
    also = (f"read too: {one.name}, SHA-256 {sha256_of(one)}" for one in beside)
    used = ReaderUsed(name=name, conventions=(*read.conventions, *also))
    return OpenedPredictions(read.predictions, chosen, used, read.notes, (benchmark, truths))


# --- predictions of strangers, which a child reads ---


def _open_limited(
    path: Path, data: Path, protocol: str | None, run: Run, **asked: Any
) -> OpenedPredictions:
    # In a container the child does not see the folder of benchmarks, which has their truth.
    stated = protocol_files(data).get(protocol or "", protocol)
    request = {"path": path, "data": data, "protocol": stated, **asked}
    request["memory_bytes"] = run.memory_bytes
    predictions, reader, notes = _open_in_child(request, path, run)
    if isinstance(predictions, ScenePredictions):
        opened = partial(_open_scene_limited, request, path, run)
        entries = {scene: partial(opened, scene) for scene in predictions.entries}
        predictions = replace(predictions, entries=entries)
    chosen = find_protocol(protocol or predictions.protocol, data)
    used = None if reader is None else ReaderUsed.model_validate(reader)
    return OpenedPredictions(predictions, chosen, used, tuple(notes))


def _open_scene_limited(
    request: Mapping[str, Any], path: Path, run: Run, scene: str, limit_bytes: int, sampling: Any
) -> AbstractContextManager[Any]:
    how = {"scene": scene, "limit_bytes": limit_bytes, "sampling": sampling}
    return nullcontext(_open_in_child({**request, **how}, path, run))


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
    memory_bytes: int,
    protocol: Path | str | None,
    scene: str | None = None,
    limit_bytes: int = 0,
    sampling: Any = None,
    **request: Any,
) -> Any:
    """Open predictions, in the child: one scene, or all, with their reader and its notes."""
    named = None if protocol is None else str(protocol)
    opened = open_predictions(run=Run(memory_bytes), protocol=named, **request)
    found: Any = opened.predictions
    if scene is not None:
        return found.entries[scene](limit_bytes, sampling)
    if isinstance(found, ScenePredictions):  # the parent has others open each scene
        listed: Any = dict.fromkeys(found.entries)
        found = replace(found, entries=listed)
    return [found, opened.reader and opened.reader.model_dump(mode="json"), list(opened.notes)]
