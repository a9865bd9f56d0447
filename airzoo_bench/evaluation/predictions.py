"""Predictions: opened in the suite's own layout, or as a reader reads a method's own files."""

from __future__ import annotations

import tempfile
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.benchmark.queries import conditions_of
from airzoo_bench.core import errors, files
from airzoo_bench.core.errors import PredictionError, UnreadableError, counted, first_of
from airzoo_bench.core.registry import READERS, TRACKS, load_track
from airzoo_bench.core.sandbox import call_limited
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.track import Assignment, Run, ScenePredictions, Track
from airzoo_bench.formats.arrays import Arrays, check_fields, protocol_name, rows_among, texts
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.protocol import model as protocols

C = TypeVar("C")

SURE = 0.5
"""A reader that is less sure than this does not take a path for its own."""

_SURE_OF_TRACK = 0.25  # the same where its track is the one that is asked for
_SHOWN = 3
FIX_READER = "name its reader by --reader NAME, see `airzoo-bench readers`, or install its package"


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
    predictions: QueryPredictions[Any], truths: Sequence[Any], protocol: protocols.Protocol
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
    missing, extra = asked[found < 0], np.delete(ids, found[found >= 0])
    ends = np.cumsum([len(some) for some in wanted])[:-1]
    parts = [QueryPart(predictions, rows) for rows in np.split(found, ends)]
    if missing.size:
        named = first_of(missing, len(asked), _SHOWN)
        notes.append(f"queries that the predictions lack, scored at their worst: {named}")
    if extra.size:
        meant = [repr(x[:80]) + nearest(x, missing.tolist(), 1) for x in extra[:_SHOWN].tolist()]
        named = first_of([*meant, *extra[_SHOWN:]], shown=_SHOWN)
        notes.append(f"ids of the predictions that are no queries, left aside: {named}")
    covered = f"{len(asked) - len(missing):,} of {counted(len(asked), 'query')}"
    return Assignment(parts, covered, notes, len(extra))


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
        raise errors.UsageError("predictions end in .npz", where=out, fix=f"name it {out}.npz")


def write_predictions(out: Path, protocol: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write the arrays of predictions and the name of their protocol as one ``.npz``."""
    with files.atomic_write(out) as stream:
        files.write_npz(stream, {"protocol": np.array(protocol), **arrays})


# --- readers of the files that methods write ---


@dataclass(frozen=True, eq=False)
class ReadRequest:
    """How to read a method's own files: all that their reader knows besides the path.

    People may give the name of a `reader`, else it is found from the files; `names`, a list of
    images, a line each, in the order in which the method saw them; and `image_size`, such as
    "640x480", of the pictures that a matcher was given, for files that do not state it.
    From `truths`, in the protocol's order and perhaps sealed, readers take names of queries, tiles
    and photos, and nothing else. Predictions may name any folder of the computer: only files in
    `folders`, or below the predictions, may be listed for them. `scenes` are all of the benchmark:
    a path that names one of them is of no other.
    """

    reader: str | None = None
    names: Path | None = None
    image_size: str | None = None
    protocol: Any = None
    truths: Sequence[Any] = ()
    memory_bytes: int = 0
    folders: tuple[Path, ...] = ()
    scenes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class PredictionFile:
    """Predictions as a reader has read them, or as their track has opened them.

    `conventions` say for the result what was taken to be so: pixel centres, axes, quaternions.
    `beside` are the files read besides the path; the result states their checksums. The rest is set
    by `open_predictions`; `truths`, with their benchmark, are those that a reader was given.
    """

    predictions: Any
    conventions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    beside: tuple[Path, ...] = ()
    reader: str | None = None
    protocol: Any = None
    truths: tuple[Benchmark, list[Any]] | None = None

    @property
    def track(self) -> Track:
        """The track of the protocol."""
        track: Track = load_track(self.protocol.track)
        return track


class Reader(ABC):
    """Reads what one method, or a family of methods, writes, into predictions of a track.

    `title` names the files for people, such as "descriptors of VPR-methods-evaluation", `layout`
    says how they are recognised, `methods` who writes them, `conventions` what they are taken for.
    """

    track: ClassVar[str]
    title: str
    layout: str
    methods: tuple[str, ...] = ()
    conventions: tuple[str, ...] = ()

    @abstractmethod
    def recognise(self, path: Path) -> float:
        """Return from 0 to 1 how sure it is that a path is its own, by the content of the files."""

    @abstractmethod
    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        """Read a path into predictions."""


def reader_named(name: str) -> Reader:
    """Return the reader of a name."""
    names = READERS.names()
    if name not in names:
        what = f"there is no reader {name[:80]!r}{nearest(name[:80], names)}"
        raise errors.UsageError(what, where="--reader", expected="one of " + ", ".join(names))
    found: Reader = READERS.get(name)
    return found


def find_reader(path: Path, track: str | None = None) -> tuple[str | None, list[str]]:
    """Return the name of the reader that recognises a path, if one does, and of all asked."""
    readers, sure = READERS.load_all(), {}
    for name, one in readers.items():
        with READERS.warning(name):
            sure[name] = float(one.recognise(path))
    of_track = {name: value for name, value in sure.items() if readers[name].track == track}
    for some, least in ((of_track, _SURE_OF_TRACK), (sure, SURE)):
        best = max([least, *some.values()])
        most = [name for name, value in some.items() if value == best]
        if len(most) > 1:
            what = f"could be {' or '.join(readers[name].title for name in most)}"
            fix = f"say which: {' or '.join(f'--reader {name}' for name in most)}"
            raise UnreadableError(what, where=path, fix=fix)
        if most:
            return most[0], [*sure]
    return None, [*sure]


# --- opening ---

DEFAULT_RUN, AS_FOUND = Run(), ReadRequest()


def open_predictions(
    path: Path,
    *,
    data: Path,
    track: str | None = None,
    protocol: str | None = None,
    run: Run = DEFAULT_RUN,
    request: ReadRequest = AS_FOUND,
) -> PredictionFile:
    """Open predictions in this process, or in a child under limits where `run` has some."""
    is_empty = path.is_dir() and not any(path.iterdir())
    if is_empty or not (path.is_file() or path.is_dir()):  # a pipe would be read without end
        near = nearest(path.name, [one.name for one in path.parent.glob("*")])
        what = "the folder is empty" if is_empty else f"no such prediction file{near}"
        fix = "`airzoo-bench template` writes an example"
        raise UnreadableError(what, where=path, expected=_list_kinds(track), fix=fix)
    if run.limits is not None:
        return _open_limited(path, data, protocol, run, track=track, request=request)
    fields, stated, chosen = files.npz_fields(path), None, None
    if path.suffix == ".npz":  # other fields may be a method's own, which its reader opens
        stated = protocol_name(NpzFile(path, run.memory_bytes, fields - {"protocol"}))
    if protocol is not None or stated is not None:
        own = [name for name in TRACKS.names() if fields & {*TRACKS.get(name).fields}][:1]
        chosen = _choose_protocol(path, protocol, stated, [*own, track], data)
        track = chosen.track
    is_own = "query_ids" in fields or path.suffix == ".parquet" or (path / "protocol.txt").is_file()
    name, asked = (request.reader, []) if request.reader or is_own else find_reader(path, track)
    if name is None:
        track = _track_by_kind(path, fields, track, asked)
        predictions = load_track(track).open(path, run.memory_bytes)
        chosen = chosen or _choose_protocol(path, None, predictions.protocol, [track], data)
        return PredictionFile(predictions, protocol=chosen)
    reader = reader_named(name)
    if track not in (None, reader.track):
        what = f"read by {name} ({reader.title}) it is of the {reader.track} track, not of {track}"
        fix = f"airzoo-bench eval {reader.track} {path} --reader {name} --protocol PROTOCOL"
        raise UnreadableError(what, where=path, fix=fix)
    chosen = chosen or _choose_protocol(path, None, None, [reader.track], data)
    request = replace(request, reader=name, protocol=chosen, memory_bytes=run.memory_bytes)
    return _read_native(path, reader, request, data)


def _read_native(path: Path, reader: Reader, asked: ReadRequest, data: Path) -> PredictionFile:
    """Read what a method wrote."""
    benchmark, truths = read_truths(asked.protocol, data, sealed=True)
    scenes = tuple(scene.id for scene in benchmark.file.scenes)
    request = replace(asked, truths=truths, folders=benchmark.image_folders, scenes=scenes)
    with READERS.blaming(str(asked.reader), f", reading {path}"):
        try:
            read = reader.read(path, request)
        except IsADirectoryError as error:
            raise UnreadableError(f"a folder, and so not {reader.title}", where=path) from error
        beside = [*read.beside, *([asked.names] if asked.names else [])]
        also = (f"read too: {one.name}, SHA-256 {files.sha256_of(one)}" for one in beside)
        read = replace(read, conventions=(*read.conventions, *also), truths=(benchmark, truths))
        return replace(read, reader=asked.reader, protocol=asked.protocol)


def _list_kinds(track: str | None = None) -> str:
    return "; ".join(f"{n}: {TRACKS.get(n).kinds}" for n in TRACKS.names() if track in (None, n))


def _choose_protocol(
    path: Path, named: str | None, stated: str | None, tracks: Sequence[str | None], data: Path
) -> protocols.Protocol:
    """Return the protocol that was named, else the one that predictions state."""
    if named is None and stated is None:
        what = "does not say which protocol it is for"
        expected = "a field 'protocol', protocol.txt in a folder or archive, or --protocol NAME"
        fix = "add --protocol PROTOCOL: `airzoo-bench protocols` lists them"
        fix += "; for fields of retrieval or matching, save an .npz" * (path.suffix == ".npy")
        raise errors.ProtocolError(what, where=path, expected=expected, fix=fix)
    try:
        chosen = protocols.find_protocol(named or str(stated), data)
    except errors.ProtocolError as error:
        raise error if named else error.inside(f"{path}, field 'protocol'") from None
    for other in (one for one in tracks if one not in (None, chosen.track)):
        what = f"protocol {chosen.name} is of the {chosen.track} track, not of the {other} track"
        wanted = tracks[0] if len(tracks) > 1 else chosen.track
        more = " --protocol NAME" * (wanted != chosen.track)
        raise PredictionError(what, where=path, fix=f"airzoo-bench eval {wanted} {path}{more}")
    return chosen


def _track_by_kind(
    path: Path, fields: frozenset[str], track: str | None, asked: Sequence[str]
) -> str:
    """Return the track of a file's own fields, or of its ending; `asked` are readers' names."""
    infos = [TRACKS.get(name) for name in TRACKS.names() if track in (None, name)]
    for info in sorted(infos, key=lambda info: not fields & {*info.fields}):
        if info.folders if path.is_dir() else path.name.lower().endswith(info.suffixes):
            return str(info.name)
    kind = "a folder" if path.is_dir() else f"a file of kind {path.suffix[:20]!r}"
    expected = f"a method's own files, or {_list_kinds(track)}"
    added = ", ".join(name for name in asked if name not in READERS.places)
    what = f"{kind} that no installed reader recognises" + f" ({added} declined it)" * bool(added)
    raise UnreadableError(what, where=path, expected=expected, fix=FIX_READER)


def read_truths(
    protocol: protocols.Protocol, data: Path, *, sealed: bool = False
) -> tuple[Benchmark, list[Any]]:
    """Find the benchmark of a protocol, and read the truth of its scenes, in its order."""
    benchmark = find_benchmark(protocol.benchmark, data, sealed=sealed)
    benchmark.check_fits(protocol)
    with benchmark.fixes():
        return benchmark, [read_truth(benchmark, protocol, one.id) for one in protocol.scenes]


def read_truth(benchmark: Benchmark, protocol: protocols.Protocol, scene: str) -> Any:
    """Read the truth of a scene, and refuse conditions that have the name of another column."""
    track = load_track(protocol.track)
    truth = track.truth(benchmark, scene)
    taken = {*track.recorded, *(score.key for score in track.scores(protocol))}
    for name in conditions_of(truth.queries).columns if hasattr(truth, "queries") else ():
        if any(fnmatchcase(name, one) for one in taken):
            what = f"condition {name} has the name of a column of {protocol.track} records"
            fix = "rename the column, then `airzoo-bench manifest FOLDER --force`"
            raise errors.BenchmarkError(
                what, where=benchmark.scene_folder(scene) / "queries.csv", fix=fix
            )
    return truth


# --- predictions of strangers, which a child reads ---


def _open_limited(
    path: Path, data: Path, protocol: str | None, run: Run, **asked: Any
) -> PredictionFile:
    # In a container the child does not see the folder of benchmarks, which has their truth.
    stated = protocols.protocol_files(data).get(protocol or "", protocol)
    request = {"path": path, "data": data, "protocol": stated, **asked}
    call = partial(_call_child, request, path, run)
    with call() as opened:
        found = opened.predictions
    if isinstance(found, ScenePredictions):  # others open each scene
        found = replace(found, entries={scene: partial(call, scene) for scene in found.entries})
    chosen = protocols.find_protocol(protocol or opened.protocol, data)
    return replace(opened, predictions=found, protocol=chosen)  # type: ignore[no-any-return]


def _call_child(request: Mapping[str, Any], path: Path, run: Run, *scene: Any) -> Any:
    """Call `open_in_child` in a child; its files stay for as long as the predictions."""
    arguments = {"memory_bytes": run.memory_bytes, "scene": scene, **request}
    assert run.limits is not None
    with ExitStack() as stack:
        parent = Path(tempfile.gettempdir())
        folder = stack.enter_context(files.temporary_folder(parent, "airzoo-bench"))
        place = f"{__name__}:open_in_child"
        found = call_limited(place, arguments, where=path, limits=run.limits, folder=folder)
        owner = found.predictions if isinstance(found, PredictionFile) else found
        weakref.finalize(owner, stack.pop_all().close)
        return nullcontext(found)


def open_in_child(
    memory_bytes: int, scene: Sequence[Any], protocol: Path | str | None, **request: Any
) -> Any:
    """Open all predictions and only list their scenes, or read one with its limit and sampling."""
    named = None if protocol is None else str(protocol)
    opened = open_predictions(run=Run(memory_bytes), protocol=named, **request)
    found: Any = opened.predictions
    if scene:
        return found.entries[scene[0]](*scene[1:])
    if isinstance(found, ScenePredictions):
        found = replace(found, entries=dict.fromkeys(found.entries))  # type: ignore[arg-type]
    return replace(opened, predictions=found, protocol=opened.protocol.name, truths=None)
