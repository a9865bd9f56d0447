"""Scoring and checking predictions of any track, making some, and the files of a run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core import errors, files
from airzoo_bench.core.errors import CameraError, PredictionError, UsageError, UserError
from airzoo_bench.core.registry import READERS, TRACKS, load_track, resolve
from airzoo_bench.core.version import versions
from airzoo_bench.evaluation.predictions import (
    AS_FOUND,
    DEFAULT_RUN,
    PredictionFile,
    ReadRequest,
    check_npz,
    open_predictions,
    read_truths,
)
from airzoo_bench.evaluation.track import Assignment, Run, SceneScores
from airzoo_bench.protocol.model import find_protocol, protocol_of_track
from airzoo_bench.results import result as results
from airzoo_bench.results.records import join_records, write_csv

_RESULT = "result.json"
_SCENE = ".scene"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A result, the records it was made from, and what figures need: truths, and scored scenes."""

    result: results.Result
    records: pd.DataFrame
    opened: PredictionFile
    benchmark: Benchmark
    truths: list[Any]
    scored: dict[str, SceneScores]


def evaluate(
    path: Path,
    *,
    data: Path,
    track: str | None = None,
    protocol: str | None = None,
    method: str | None = None,
    run: Run = DEFAULT_RUN,
    request: ReadRequest = AS_FOUND,
    unfinished: Path | None = None,
) -> Evaluation:
    """Score predictions; scenes are kept in a folder `unfinished` until all are scored."""
    opened = open_predictions(
        path, data=data, track=track, protocol=protocol, run=run, request=request
    )
    chosen, known = opened.protocol, opened.truths
    benchmark, truths = known if known and not known[0].is_sealed else read_truths(chosen, data)
    assignment = opened.track.assign(opened.predictions, truths, chosen)
    for error in assignment.errors:
        raise error
    sha256, of_truths = files.sha256_of_tree(path), truth_fingerprint(truths)
    used = None
    if opened.reader is not None:
        used = results.ReaderUsed(name=opened.reader, conventions=opened.conventions)
    inputs = [sha256, opened.reader, opened.conventions, chosen.fingerprint, of_truths, versions()]
    scored: dict[str, SceneScores] = {}
    parts = zip(truths, assignment.parts, strict=True)
    for truth, part in run.progress(parts, "scenes", len(truths)):
        score = partial(opened.track.score, part, truth, chosen, run)
        if unfinished is not None:
            score = partial(keep_scene, unfinished, [*inputs, truth.scene], score)
        scored[truth.scene] = score()
    noted = [*assignment.facts, *benchmark.warnings_of(scored)]
    scores = opened.track.scores(chosen)
    scores, records = join_records([scene.records for scene in scored.values()], scores)
    result = results.Result(
        track=chosen.track,
        protocol=results.ProtocolUsed(
            name=chosen.name,
            version=chosen.version,
            fingerprint=chosen.fingerprint,
            settings=chosen.settings(),
        ),
        truth=results.TruthUsed(
            benchmark=benchmark.name,
            version=benchmark.file.version,
            fingerprint=of_truths,
            scene_titles={scene.id: scene.title for scene in chosen.scenes},
        ),
        predictions=results.PredictionsUsed(
            file=path.name,
            sha256=sha256,
            kind=", ".join(sorted({scene.kind for scene in scored.values() if scene.kind})),
            method=method or (path.name if path.is_dir() else path.stem),
            reader=used,
        ),
        versions=dict(versions()),
        columns=tuple(scores),
        counts={name: scene.counts for name, scene in scored.items()},
        extra_queries=assignment.extra_queries,
        notes=(*noted, *_list_notes(opened, truths, assignment, scored)),
        **asdict(results.summarise(records, scores, [scene.id for scene in chosen.scenes])),
        references=dict(opened.track.references(chosen, truths)),
    )
    if unfinished is not None:
        for file in unfinished.glob(f"*{_SCENE}"):
            file.unlink()
        with suppress(OSError):  # a user's own files are in it
            unfinished.rmdir()
    return Evaluation(result.with_checksum(), records, opened, benchmark, truths, scored)


def keep_scene(folder: Path, run: Sequence[Any], score: Callable[[], SceneScores]) -> SceneScores:
    """Return what a folder has kept of a scene of this run, or score it and keep that."""
    file = folder / (files.fingerprint(run)[:32] + _SCENE)
    with suppress(OSError, ValueError, KeyError, TypeError):  # there is none, or it is damaged
        records = pd.read_parquet(file)
        rest: Any = records.attrs
        records.attrs = {}
        return SceneScores(records, **rest)
    scored = score()
    records = scored.records.copy(deep=False)
    records.attrs = {name: getattr(scored, name) for name in ("counts", "kind", "notes", "facts")}
    with files.atomic_write(file) as stream:
        records.to_parquet(stream)
    return scored


def _list_notes(
    opened: PredictionFile,
    truths: Sequence[Any],
    assignment: Assignment,
    scored: Mapping[str, SceneScores],
) -> list[str]:
    """Return notes on files and scenes, and on all together where no scene is lacking."""
    counts = [
        f"scene {scene.title} has {here:,} queries here, {scene.queries:,} in the paper"
        for scene in opened.protocol.scenes
        if scene.id in scored and scene.queries is not None
        if (here := scored[scene.id].counts.get("queries", scene.queries)) != scene.queries
    ]
    notes = [note for scene in scored.values() for note in scene.notes]
    if len(scored) == len(truths):
        scenes = [*scored.values()]
        notes += opened.track.notes(opened.predictions, truths, opened.protocol, scenes)
    return [*counts, *opened.notes, *assignment.notes, *notes]


def truth_fingerprint(truths: Sequence[Any]) -> str:
    """Return the SHA-256 over all that scores of some scenes depend on."""
    return files.fingerprint({truth.scene: truth.fingerprint for truth in truths})


@dataclass(eq=False, repr=False)
class Check:
    """The faults of predictions: `errors` is a list of `UserError`, `notes` is a list of texts.

    `described` is a list of texts too: of what kind they are, and how much they answer.
    """

    errors: list[UserError] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    described: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        lines = [*map(str, self.errors), *(f"note: {note}" for note in self.notes)]
        return "\n".join(lines) or "nothing wrong was found"


def check(
    path: Path,
    *,
    data: Path,
    protocol: str | None = None,
    run: Run = DEFAULT_RUN,
    request: ReadRequest = AS_FOUND,
) -> Check:
    """Find errors of predictions, the first in each file or scene, without scoring them.

    The benchmark folder may be one whose truth is sealed.
    """
    found, scored = Check(), {}
    try:
        opened = open_predictions(path, data=data, protocol=protocol, run=run, request=request)
        found.described, found.notes = _describe(opened), [*opened.notes]
        _, truths = opened.truths or read_truths(opened.protocol, data, sealed=True)
        assignment = opened.track.assign(opened.predictions, truths, opened.protocol)
    except errors.UnreadableError:
        raise
    except (PredictionError, CameraError) as error:
        found.errors.append(error)
        return found
    found.errors += assignment.errors
    for part, truth in zip(assignment.parts, truths, strict=True):
        try:  # errors of a scene hide no others
            if part is not None:
                scored[truth.scene] = opened.track.check(part, truth, opened.protocol, run)
        except (PredictionError, CameraError) as error:
            found.errors.append(error)
    found.described += [f"answers {assignment.covered}", *assignment.facts]
    found.notes = _list_notes(opened, truths, assignment, scored)
    return found


def _describe(opened: PredictionFile) -> list[str]:
    what = f"{opened.protocol.track} predictions for {opened.protocol.name}"
    if opened.reader is None:
        return [what]
    reader = READERS.get(opened.reader)
    writers = f" ({', '.join(reader.methods)})" if reader.methods else ""
    what = f"{reader.title}{writers}: {what}, read by --reader {opened.reader}"
    return [what, *(f"taken to be so: {convention}" for convention in opened.conventions)]


def run_baseline(
    track: str,
    protocol: str,
    out: Path,
    *,
    data: Path,
    settings: Any = None,
    run: Run = DEFAULT_RUN,
    note: Callable[[str], None] = lambda _: None,
) -> None:
    """Run a track's baseline on a benchmark and write predictions."""
    baseline = TRACKS.get(track).baseline
    chosen = protocol_of_track(protocol, data, load_track(track).protocol)
    benchmark = find_benchmark(chosen.benchmark, data, sealed=True)
    benchmark.check_fits(chosen)
    with benchmark.fixes():
        resolve(baseline.predict)(chosen, benchmark, settings or baseline.settings, out, run, note)


def write_template(
    protocol: str, *, data: Path, out: Path | None = None, kind: str | None = None
) -> tuple[Path, str | None]:
    """Write a prediction at random; return where, and the track unless the truth is sealed."""
    chosen = find_protocol(protocol, data)
    info = TRACKS.get(chosen.track)
    if kind is not None and kind not in info.templates:
        raise UsageError(f"templates of the {info.name} track have no kind {kind!r}")
    target = out or Path("template" if info.folders else "template.npz")
    if not info.folders:
        check_npz(target)
    if target.is_file() or (target.is_dir() and any(target.iterdir())):
        raise UsageError("is there already", where=target, fix="name another place with --out")
    benchmark, truths = read_truths(chosen, data, sealed=True)
    load_track(info.name).template(target, truths, chosen, kind or (*info.templates, "")[0])
    return target, None if benchmark.is_sealed else info.name


# --- the files of a run ---


def check_run_folder(out: Path, predictions: str | Path) -> list[str]:
    """Refuse, before any work, a folder where a run would replace predictions or a user's own.

    Return the names of the entries that runs of any track leave, the folder of figures last.
    """
    tracks = [TRACKS.get(name) for name in TRACKS.names()]
    names = [_RESULT, "records.csv", *(name for info in tracks for name in info.files)]
    files.check_output_folder(out, names)
    source, is_run = Path(predictions).resolve(), (out / _RESULT).exists()
    for name in (*names, "figures"):
        is_own = name == "figures" and (out / name).exists() and not is_run
        if is_own or source.is_relative_to(out.resolve() / name):
            what = f"the run would replace {name}, which no run wrote"
            raise UsageError(what, where=out / name, fix="move it, or name another --out")
    return [*names, "figures"]


def save(
    evaluation: Evaluation, folder: Path, draw: Callable[[Path], None] | None = None
) -> list[Path]:
    """Write the files of a run into a folder, in place of an earlier run's."""
    names = check_run_folder(folder, evaluation.opened.predictions.path)
    with files.atomic_entries(folder, names) as staged:
        checksum = write_csv(evaluation.records, staged / "records.csv")
        result = evaluation.result.with_checksum(records_sha256=checksum)
        results.write_result(staged / _RESULT, result)
        for name, write in TRACKS.get(result.track).files.items():
            resolve(write)(evaluation, staged / name)
        if draw is not None:
            draw(staged)
        return [folder / name for name in names[:-1] if (staged / name).exists()]
