"""Opening predictions: of which track and protocol they are, and their truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from airzoo_bench.benchmark.folder import Benchmark, benchmark_place, find_benchmark
from airzoo_bench.core.errors import BenchmarkError, UnreadableError, UsageError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.core.registry import TRACKS, load_track
from airzoo_bench.evaluation.checked_truth import read_checked_truth
from airzoo_bench.evaluation.info import TrackInfo
from airzoo_bench.evaluation.near_places import place_meant, refuse_part, refuse_special
from airzoo_bench.evaluation.reader import (
    Reading,
    find_reader,
    picture_size,
    read_native,
    reader_named,
)
from airzoo_bench.evaluation.track import Predictions, Run, Track, Truth
from airzoo_bench.formats.arrays import open_arrays, protocol_name
from airzoo_bench.protocol.lookup import (
    choose_protocol,
    find_protocol,
    prepared_protocols,
    refuse_other_track,
)
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import ReaderUsed

__all__ = ["Given", "ReadBy", "open_predictions", "read_truths", "track_of"]

_OFFERED = 3
_IN_A_FOLDER = (
    "protocol.txt in the folder or archive, or a field 'protocol' in a file alone",
    "name it with --protocol; `airzoo-bench protocols` lists them",
)


@dataclass(frozen=True)
class ReadBy:
    """How predictions in a method's own files are to be read.

    Attributes
    ----------
    reader : str or None
        The reader's name; by default the one that recognises the files, if any does.
    names : Path or None
    image_size : str or None
        See `reader.Reading`; such as "640x480".
    """

    reader: str | None = None
    names: Path | None = None
    image_size: str | None = None


@dataclass(frozen=True, eq=False)
class Given:
    """Predictions, as read or listed, with their track and protocol.

    Attributes
    ----------
    data : Path
        The benchmark folder, or the folder that holds it.
    reader : ReaderUsed or None
        What read a method's own files.
    notes : tuple of str
        The reader's.
    truths : tuple or None
        The benchmark and its truths, where the reader was given them.
    """

    track: Track
    predictions: Predictions
    protocol: Protocol
    data: Path
    reader: ReaderUsed | None = None
    notes: tuple[str, ...] = ()
    truths: tuple[Benchmark, list[Truth]] | None = None


def open_predictions(
    path: Path,
    track: str | None,
    protocol: str | None,
    data: Path,
    run: Run,
    read_by: ReadBy = ReadBy(),
) -> Given:
    """Read or list predictions."""
    refuse_special(path)
    reader = read_by.reader or _reader_of(path, track, protocol, data)
    if reader is not None:
        return _open_native(path, reader, track, protocol, data, run, read_by)
    if read_by.names is not None or read_by.image_size is not None:
        option = "--names" if read_by.names is not None else "--image-size"
        raise UsageError(
            f"{option} is for files as methods write them, and no reader takes these for its own",
            where=path,
            fix="leave it out, or say which reader: --reader NAME",
        )
    found: TrackInfo = TRACKS.get(track or track_of(path, protocol, data, run))
    _refuse_missing(path, found)
    try:
        predictions = _read_own(path, found, track, protocol, data, run)
    except UnreadableError as error:
        meant = place_meant(path, found.name) if path.is_dir() else None
        if meant is None:
            raise
        raise UnreadableError(
            error.what, where=error.where, expected=error.expected, fix=meant
        ) from error
    model = load_track(found.name)
    says = _IN_A_FOLDER if found.folders else None
    chosen = choose_protocol(path, predictions.protocol, protocol, data, model.protocol, says)
    return Given(model, predictions, chosen, data)


def _read_own(
    path: Path,
    found: TrackInfo,
    asked: str | None,
    protocol: str | None,
    data: Path,
    run: Run,
) -> Predictions:
    if asked is not None:
        _refuse_other_kind(path, found)
    track = load_track(found.name)
    refuse_other_track(path, protocol, data, track.protocol, run.memory_bytes)
    opened: Predictions = track.open(path, run.memory_bytes)
    return opened


def _open_native(
    path: Path,
    name: str,
    track: str | None,
    protocol: str | None,
    data: Path,
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
    found: Track = load_track(reader.track)
    there = prepared_protocols(reader.track, data) if protocol is None else []
    listed = " or ".join(f"--protocol {one}" for one in there[:_OFFERED])
    says = (
        f"--protocol NAME, for what was read as {reader.title}",
        f"{listed}; `airzoo-bench protocols` lists them all"
        if listed
        else "`airzoo-bench protocols` lists them",
    )
    chosen = choose_protocol(path, None, protocol, data, found.protocol, says)
    try:
        known = read_truths(chosen, data, sealed=True)
    except BenchmarkError:
        if benchmark_place(chosen.benchmark, data).is_dir():
            raise  # it is there, and damaged or of other settings
        known = None  # readers say what they cannot tell without; scoring says that it is missing
    names, size = read_by.names, picture_size(read_by.image_size)
    reading = Reading(chosen, [], names, run.memory_bytes, image_size=size)
    if known is not None:
        benchmark, truths = known
        scenes = tuple(scene.id for scene in benchmark.file.scenes)
        reading = replace(reading, truths=truths, folders=benchmark.image_folders, scenes=scenes)
    read = read_native(reader, path, reading)
    beside = [*read.beside, *([names] if names else [])]
    also = (f"read too: {one.name}, SHA-256 {sha256_of(one)}" for one in beside)
    used = ReaderUsed(name=name, conventions=(*read.conventions, *also))
    return Given(found, read.predictions, chosen, data, used, read.notes, known)


def _reader_of(path: Path, track: str | None, protocol: str | None, data: Path) -> str | None:
    if not path.exists():
        return None
    if track is None and protocol is not None:
        track = find_protocol(protocol, data).track
    found = find_reader(path, track)
    if found is None and path.is_file() and track is not None:
        refuse_part(path, track)
    return found


def _refuse_missing(path: Path, asked: TrackInfo) -> None:
    if not path.exists():
        raise UnreadableError(
            "no such predictions" if asked.folders else "no such prediction file",
            where=path,
            expected=asked.kinds,
            fix="`airzoo-bench template` writes an example",
        )


def _refuse_other_kind(path: Path, asked: TrackInfo) -> None:
    """Refuse what only predictions of other tracks come as, and name the command for those."""
    tracks: list[TrackInfo] = [TRACKS.get(name) for name in TRACKS.names()]
    ending = _ending(path, {suffix for track in tracks for suffix in track.suffixes})
    if path.is_dir():
        what, fitting = "a folder", [track for track in tracks if track.folders]
    else:
        what, fitting = f"a {ending} file", [track for track in tracks if ending in track.suffixes]
    if path.exists() and fitting and asked not in fitting:
        raise UnreadableError(
            f"{what}, as predictions of the {fitting[0].name} track are, not those of the "
            f"{asked.name} track",
            where=path,
            expected=asked.kinds,
            fix=f"those are scored by `airzoo-bench eval {fitting[0].name} {path}`",
        )


def read_truths(
    protocol: Protocol, data: Path, *, sealed: bool = False
) -> tuple[Benchmark, list[Truth]]:
    """Find the benchmark of a protocol, and read the truth of its scenes, in its order."""
    benchmark = find_benchmark(protocol.benchmark, data, sealed=sealed)
    benchmark.check_fits(protocol)
    with benchmark.fixes():
        scenes = [scene.id for scene in protocol.scenes]
        return benchmark, [read_checked_truth(benchmark, protocol, one) for one in scenes]


def track_of(path: Path, protocol: str | None, data: Path, run: Run) -> str:
    """Name the track of predictions by their protocol, else by what kind of file they are."""
    tracks: list[TrackInfo] = [TRACKS.get(name) for name in TRACKS.names()]
    ending = _ending(path, {suffix for track in tracks for suffix in track.suffixes})
    fitting = [track for track in tracks if ending in track.suffixes]
    if path.is_file() and not fitting:
        raise UnreadableError(
            f"no kind of file that predictions come in: {path.suffix[:20]!r}",
            where=path,
            expected="; ".join(f"{track.name}: {track.kinds}" for track in tracks),
            fix="`airzoo-bench template` writes an example",
        )
    if path.is_file() and len(fitting) == 1:
        return fitting[0].name
    fields: set[str] = set()
    if path.is_file() and path.suffix == ".npz":
        arrays = open_arrays(path, run.memory_bytes)
        fields = arrays.names()
        protocol = protocol or protocol_name(arrays)
    if protocol is not None:
        return str(find_protocol(protocol, data).track)
    return _by_content(path, fitting or tracks, fields)


def _ending(path: Path, endings: set[str]) -> str:
    """Return the longest ending that a name has: of ``a.tar.gz`` it is not ``.gz``."""
    name = path.name.lower()
    return max((ending for ending in endings if name.endswith(ending)), key=len, default="")


def _by_content(path: Path, tracks: list[TrackInfo], fields: set[str]) -> str:
    own = [track for track in tracks if fields & {*track.fields}]
    folders = [track for track in tracks if path.is_dir() and track.folders]
    return (own or folders or tracks)[0].name
