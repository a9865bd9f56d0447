"""Scoring and checking predictions of any track, making some, and the files of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.errors import (
    CameraError,
    PredictionError,
    UnreadableError,
    UsageError,
    UserError,
)
from airzoo_bench.core.files import (
    PART,
    atomic_entries,
    atomic_write,
    check_output_folder,
    fingerprint,
    sha256_of,
    sha256_of_tree,
)
from airzoo_bench.core.registry import READERS, TRACKS, load_track, resolve
from airzoo_bench.core.version import versions
from airzoo_bench.evaluation.predictions import (
    AS_FOUND,
    HERE,
    OpenedPredictions,
    ReaderOptions,
    check_npz,
    open_predictions,
    read_truths,
)
from airzoo_bench.evaluation.track import Assignment, Run, SceneScores, Truth
from airzoo_bench.protocol.model import find_protocol, protocol_of_track
from airzoo_bench.results.records import write_csv
from airzoo_bench.results.result import (
    PredictionsUsed,
    ProtocolUsed,
    Result,
    ScoreColumn,
    TruthUsed,
    summarise,
    write_result,
)

_RESULT = "result.json"
_SCENE = ".scene"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A result, the records it was made from, and what figures need: truths, and scored scenes."""

    result: Result
    records: pd.DataFrame
    opened: OpenedPredictions
    benchmark: Benchmark
    truths: list[Any]
    scored: dict[str, SceneScores]

    @property
    def protocol(self) -> Any:
        """The protocol, of its track's own class."""
        return self.opened.protocol


def evaluate(
    path: Path,
    *,
    data: Path,
    track: str | None = None,
    protocol: str | None = None,
    method: str | None = None,
    run: Run = HERE,
    read_by: ReaderOptions = AS_FOUND,
    unfinished: Path | None = None,
) -> Evaluation:
    """Score predictions; scenes are kept in a folder `unfinished` until all are scored."""
    opened = open_predictions(
        path, data=data, track=track, protocol=protocol, run=run, read_by=read_by
    )
    chosen, known = opened.protocol, opened.truths
    benchmark, truths = known if known and not known[0].is_sealed else read_truths(chosen, data)
    assignment = opened.track.assign(opened.predictions, truths, chosen)
    for error in assignment.errors:
        raise error
    sha256, of_truths = sha256_of_tree(path), truth_fingerprint(truths)
    store = None
    if unfinished is not None:  # versions too, but not code that is being changed
        reader = None if opened.reader is None else opened.reader.model_dump(mode="json")
        names = None if read_by.names is None else sha256_of(read_by.names)
        inputs = [sha256, reader, names, chosen.fingerprint, of_truths, versions()]
        store = SceneStore(unfinished, fingerprint([*inputs, run.memory_bytes]))
    scored: dict[str, SceneScores] = {}
    parts = zip(truths, assignment.parts, strict=True)
    for truth, part in run.progress(parts, "scenes", len(truths)):
        scene = None if store is None else store.load(truth.scene)
        if scene is None:
            scene = opened.track.score(part, truth, chosen, run)
            if store is not None:
                store.save(truth.scene, scene)
        scored[truth.scene] = scene
    scores, records = _join_records([*scored.values()], opened.track.scores(chosen))
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
            reader=opened.reader,
        ),
        versions=dict(versions()),
        columns=tuple(scores),
        counts={name: scene.counts for name, scene in scored.items()},
        extra_queries=assignment.strange,
        notes=tuple(_list_notes(opened, truths, assignment, [*scored.values()])),
        **asdict(summarise(records, scores, [scene.id for scene in chosen.scenes])),
        references=dict(opened.track.references(chosen, truths)),
    )
    if store is not None:
        store.remove()
    return Evaluation(result.with_checksum(), records, opened, benchmark, truths, scored)


def _list_notes(
    opened: OpenedPredictions,
    truths: Sequence[Truth],
    assignment: Assignment,
    scored: Sequence[SceneScores],
) -> list[str]:
    """Return the notes on files, scenes and all together, for a reader of the scores."""
    counts = [
        f"scene {scene.title} has {one.counts['queries']:,} queries here, "
        f"{scene.queries:,} in the paper"
        for scene, one in zip(opened.protocol.scenes, scored, strict=True)
        if scene.queries not in (None, one.counts.get("queries", scene.queries))
    ]
    of_scenes = [note for scene in scored for note in scene.notes]
    of_track = opened.track.notes(opened.predictions, truths, opened.protocol, scored)
    return [*counts, *opened.notes, *assignment.notes, *of_scenes, *of_track]


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
    run: Run = HERE,
    read_by: ReaderOptions = AS_FOUND,
) -> Checked:
    """Find errors of predictions, the first in each file or scene, without scoring them.

    The benchmark folder may be one whose truth is sealed.
    """
    described: list[str] = []
    notes: list[str] = []
    try:
        opened = open_predictions(path, data=data, protocol=protocol, run=run, read_by=read_by)
        described, notes = _describe(opened), [*opened.notes]
        _, truths = opened.truths or read_truths(opened.protocol, data, sealed=True)
        assignment = opened.track.assign(opened.predictions, truths, opened.protocol)
    except UnreadableError:
        raise
    except (PredictionError, CameraError) as error:
        return Checked([error], notes, described)
    errors: list[UserError] = [*assignment.errors]
    scored = []
    for part, truth in zip(assignment.parts, truths, strict=True):
        try:  # errors of a scene hide no others
            if part is not None:
                scored.append(opened.track.check(part, truth, opened.protocol, run))
        except (PredictionError, CameraError) as error:
            errors.append(error)
    described.append(f"answers {assignment.covered}")
    if not errors:
        return Checked([], _list_notes(opened, truths, assignment, scored), described)
    notes += [*assignment.notes, *(note for one in scored for note in one.notes)]
    return Checked(errors, notes, described)


def _describe(opened: OpenedPredictions) -> list[str]:
    what = f"{opened.protocol.track} predictions for {opened.protocol.name}"
    if opened.reader is None:
        return [what]
    reader = READERS.get(opened.reader.name)
    writers = f" ({', '.join(reader.methods)})" if reader.methods else ""
    what = f"{reader.title}{writers}: {what}, read by --reader {opened.reader.name}"
    return [what, *(f"taken to be so: {convention}" for convention in opened.reader.conventions)]


def run_baseline(
    track: str,
    protocol: str,
    out: Path,
    *,
    data: Path,
    settings: Any = None,
    run: Run = HERE,
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


# --- the files of a run ---


def check_run_folder(out: Path, predictions: str | Path) -> list[str]:
    """Refuse, before any work, a folder where a run would replace predictions or a user's own.

    Return the names of the entries that runs of any track leave, the folder of figures last.
    """
    tracks = [TRACKS.get(name) for name in TRACKS.names()]
    files = [_RESULT, "records.csv", *(name for info in tracks for name in info.files)]
    check_output_folder(out, files)
    source, is_run = Path(predictions).resolve(), (out / _RESULT).exists()
    for name in (*files, "figures"):
        is_own = name == "figures" and (out / name).exists() and not is_run
        if is_own or source.is_relative_to(out.resolve() / name):
            raise UsageError(
                f"the run would replace {name}, which no run wrote",
                where=out / name,
                fix="move it elsewhere, or name another --out",
            )
    return [*files, "figures"]


def save(
    evaluation: Evaluation, folder: Path, draw: Callable[[Path], None] | None = None
) -> list[Path]:
    """Write the files of a run into a folder, in place of an earlier run's."""
    names = check_run_folder(folder, evaluation.opened.predictions.path)
    with atomic_entries(folder, names) as staged:
        checksum = write_csv(evaluation.records, staged / "records.csv")
        result = evaluation.result.with_records(checksum)
        write_result(staged / _RESULT, result)
        for name, write in TRACKS.get(result.track).files.items():
            resolve(write)(evaluation, staged / name)
        if draw is not None:
            draw(staged)
        return [folder / name for name in names[:-1] if (staged / name).exists()]


@dataclass(frozen=True)
class SceneStore:
    """Keeps the scores of scenes in a folder, under the fingerprint of their run."""

    folder: Path
    run: str

    def load(self, scene: str) -> SceneScores | None:
        """Return what this run has kept of a scene, if it is there and whole."""
        try:
            records = pd.read_parquet(self._place(scene))
            rest, records.attrs = records.attrs, {}
            return SceneScores(records, **(rest | {"notes": tuple(rest["notes"])}))
        except (OSError, ValueError, KeyError, TypeError):  # there is none, or it is damaged
            return None

    def save(self, scene: str, scored: SceneScores) -> None:
        """Keep the scores of a scene, without what figures show of it."""
        records = scored.records.copy(deep=False)
        names = ("counts", "kind", "notes", "facts")
        records.attrs = {name: getattr(scored, name) for name in names}
        with atomic_write(self._place(scene)) as stream:
            records.to_parquet(stream)

    def remove(self) -> None:
        """Remove what is kept, and nothing else."""
        with suppress(OSError):  # there is none, or something else is in it
            for path in self.folder.iterdir():
                if path.name.endswith((_SCENE, PART)):
                    path.unlink()
            self.folder.rmdir()

    def _place(self, scene: str) -> Path:
        return self.folder / (fingerprint([self.run, scene])[:32] + _SCENE)
