"""The reconstruction track: photos become a cloud."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError, UnreadableError, first_of
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.track import Assignment, Run, ScenePredictions, Scored, Track
from airzoo_bench.formats.archives import ARCHIVE_SUFFIXES
from airzoo_bench.formats.arrays import open_arrays, protocol_name
from airzoo_bench.formats.clouds.suffixes import KINDS
from airzoo_bench.reconstruction.alignment.cameras import alignment_values
from airzoo_bench.reconstruction.info import INFO
from airzoo_bench.reconstruction.listed import ListedScenes
from airzoo_bench.reconstruction.reading import open_reconstruction
from airzoo_bench.reconstruction.scenes import read_through, scored_scene
from airzoo_bench.reconstruction.scores import RECORDED, reconstruction_scores
from airzoo_bench.reconstruction.scoring import ScoredScene, score_missing
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.template import depth_template
from airzoo_bench.reconstruction.truth import ReconstructionTruth, read_truth
from airzoo_bench.results.scores import Score

__all__ = ["TRACK", "ReconstructionTrack", "write_alignments"]

_UNPACKED_BYTES = 1 << 40


class ReconstructionTrack(Track):
    """Multi-view reconstruction; see `Track`. All scenes share the listed predictions."""

    info = INFO
    protocol = ReconstructionProtocol
    recorded = RECORDED

    def open(self, path: Path, memory_bytes: int) -> ScenePredictions:
        """List predictions; see `open_reconstruction`."""
        if path.is_file() and not path.name.lower().endswith(INFO.suffixes):
            raise UnreadableError(
                f"no kind of file that reconstructions come in: {path.suffix[:20]!r}",
                where=path,
                expected=f"a folder with an entry a scene, an archive of it "
                f"({', '.join(ARCHIVE_SUFFIXES)}), or one scene's {KINDS}",
                fix="`airzoo-bench template` writes an example",
            )
        predictions = open_reconstruction(path, unpacked_limit_bytes=_UNPACKED_BYTES)
        if path.is_file() and path.suffix == ".npz":
            return replace(predictions, protocol=protocol_name(open_arrays(path, memory_bytes)))
        return predictions

    def truth(self, benchmark: Benchmark, scene: str) -> ReconstructionTruth:
        """See `Track.truth`."""
        return read_truth(benchmark, scene)

    def assign(
        self,
        predictions: ScenePredictions,
        truths: Sequence[ReconstructionTruth],
        protocol: ReconstructionProtocol,
    ) -> Assignment:
        """See `Track.assign`; a part is all predictions and the id of its scene."""
        known = [scene.id for scene in protocol.scenes]
        if not set(known) & set(predictions.scenes):
            raise PredictionError(
                f"holds none of the scenes of {protocol.name}: {first_of(predictions.scenes)}"
                + nearest(next(iter(predictions.scenes), "")[:80], known, 1),
                where=predictions.path,
                expected=f"an entry a scene: {first_of(known)}",
                fix="name files or folders by their scenes, or name the right protocol with "
                "--protocol",
            )
        listed = ListedScenes(predictions, known)
        parts = [(predictions, scene) for scene in known]
        return Assignment(parts, listed.covered, listed.notes(), len(listed.strange))

    def score(
        self,
        part: tuple[ScenePredictions, str],
        truth: ReconstructionTruth,
        protocol: ReconstructionProtocol,
        run: Run,
    ) -> Scored:
        """See `Track.score`."""
        predictions, scene = part
        if scene not in predictions.scenes:
            return _scored(score_missing(scene, protocol.scores))
        with scored_scene(predictions, truth, protocol, run) as found:
            if not run.keep:
                return _scored(found)
            trusted = run.limits is None
            return _scored(found, _kept(found, predictions.path, trusted))

    def check(
        self,
        part: tuple[ScenePredictions, str],
        truth: ReconstructionTruth | None,
        protocol: ReconstructionProtocol,
        run: Run,
    ) -> Scored:
        """Score the scene where there is a truth: only that finds all that scoring would refuse."""
        predictions, scene = part
        if truth is not None and not truth.is_sealed:
            return self.score(part, truth, protocol, run)
        if scene not in predictions.scenes:
            return Scored()
        return Scored(notes=tuple(read_through(predictions, scene, protocol, run.memory_bytes)))

    def scores(self, protocol: ReconstructionProtocol) -> list[Score]:
        """Return all scores; those of poses are in no record where no scene has cameras."""
        return reconstruction_scores(protocol.scores, with_poses=True)

    def template(
        self,
        out: Path,
        truths: Sequence[ReconstructionTruth],
        protocol: ReconstructionProtocol,
        kind: str,
        seed: int,
    ) -> str | None:
        """Write a folder with random depth maps of each scene."""
        for number, truth in enumerate(truths):
            with atomic_write(out / f"{truth.scene}.npz") as stream:
                write_npz(stream, depth_template(truth, seed + number))
        with atomic_write(out / "protocol.txt", "w") as text:
            text.write(protocol.name + "\n")
        return None


def _scored(scene: ScoredScene, kept: ScoredScene | None = None) -> Scored:
    records = pd.DataFrame([scene.record])
    counted = sorted({*scene.counts} & {*records})
    facts = {} if scene.alignment is None else {"alignment": alignment_values(scene.alignment)}
    return Scored(
        records.astype(dict.fromkeys(counted, "Int64")),
        scene.counts,
        scene.kind,
        scene.notes,
        facts,
        kept,
    )


def _kept(scene: ScoredScene, path: Path, trusted: bool) -> ScoredScene:
    """Return the scene with clouds that can be read once the predictions are closed."""
    if (trusted and path.is_dir()) or scene.clouds is None:
        return scene
    predicted, true = scene.clouds
    return replace(scene, clouds=(predicted.in_memory(), true))


def write_alignments(evaluation: Evaluation, path: Path) -> None:
    """Write ``alignment.json``: how each scene was aligned, its scale and its residuals."""
    found = {name: one.facts.get("alignment") for name, one in evaluation.scored.items()}
    values = {name: one for name, one in found.items() if one is not None}
    with atomic_write(path, "w") as stream:
        stream.write(json.dumps(values, indent=1, allow_nan=False) + "\n")


TRACK = ReconstructionTrack()
