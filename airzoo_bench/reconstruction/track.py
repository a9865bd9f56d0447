"""The reconstruction track: photos become a cloud."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.track import Assignment, Run, ScenePredictions, Scored, Track
from airzoo_bench.formats.arrays import open_arrays, protocol_name
from airzoo_bench.reconstruction.info import INFO
from airzoo_bench.reconstruction.predictions import open_reconstruction
from airzoo_bench.reconstruction.scoring import (
    RECORDED,
    read_through,
    reconstruction_scores,
    score_missing,
    score_scene,
)
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import ReconstructionTruth, read_truth
from airzoo_bench.results.scores import Score

_TEMPLATE_PX = 32  # the longer side of its maps
_TEMPLATE_DEPTH_M = (20.0, 120.0)


class ReconstructionTrack(Track):
    """Multi-view reconstruction; a part is all predictions, listed, and the id of a scene."""

    info = INFO
    protocol = ReconstructionProtocol
    recorded = RECORDED

    def open(self, path: Path, memory_bytes: int) -> ScenePredictions:
        """List predictions; see `open_reconstruction`."""
        predictions = open_reconstruction(path)
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
        """See `Track.assign`."""
        known = [scene.id for scene in protocol.scenes]
        strange = [name for name in predictions.scenes if name not in known]
        missing = [name for name in known if name not in predictions.scenes]
        if len(missing) == len(known):
            raise PredictionError(
                f"holds none of the scenes of {protocol.name}: {first_of(predictions.scenes)}"
                + nearest(next(iter(predictions.scenes), "")[:80], known, 1),
                where=predictions.path,
                expected=f"an entry a scene: {first_of(known)}",
                fix="name files or folders by their scenes, or the right protocol with --protocol",
            )
        left_out = {
            "scenes that the predictions lack, scored at their worst": missing,
            "scenes that the protocol lacks, left aside": [
                name[:80] + nearest(name[:80], missing, 1) for name in strange
            ],
            "files that belong to no scene, left aside": [
                name[:80] for name in predictions.unknown_files
            ],
        }
        notes = [f"{what}: {first_of(names)}" for what, names in left_out.items() if names]
        covered = f"{len(known) - len(missing):,} of {counted(len(known), 'scene')}"
        return Assignment([(predictions, scene) for scene in known], covered, notes, len(strange))

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
            return score_missing(scene, protocol.scores)
        return score_scene(predictions, truth, protocol, run)

    def check(
        self,
        part: tuple[ScenePredictions, str],
        truth: ReconstructionTruth,
        protocol: ReconstructionProtocol,
        run: Run,
    ) -> Scored:
        """Score the scene, which finds all errors; where its truth is sealed, only read it."""
        predictions, scene = part
        if not truth.is_sealed:
            return self.score(part, truth, protocol, run)
        if scene not in predictions.scenes:
            return Scored()
        return Scored(notes=read_through(predictions, scene, protocol, run.memory_bytes))

    def scores(self, protocol: ReconstructionProtocol) -> list[Score]:
        """Return all scores; without cameras, records lack the pose scores."""
        return reconstruction_scores(protocol.scores)

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
                write_npz(stream, _random_views(truth, np.random.default_rng(seed + number)))
        with atomic_write(out / "protocol.txt", "w") as text:
            text.write(protocol.name + "\n")
        return None


def _random_views(
    truth: ReconstructionTruth, random: np.random.Generator
) -> dict[str, NDArray[Any]]:
    """Make small random depth maps at random poses, one for each photo of a scene."""
    count = len(truth.photos)
    size = np.array([truth.cameras.width[0], truth.cameras.height[0]], dtype=np.float64)
    width, height = np.maximum(np.rint(size * _TEMPLATE_PX / size.max()), 1).astype(int)
    turned, _ = np.linalg.qr(random.normal(size=(count, 3, 3)))
    turned *= np.linalg.det(turned)[:, None, None]
    middle = np.zeros(3) if truth.is_sealed else truth.poses.centres.mean(axis=0)
    centres = middle + random.normal(0.0, 50.0, (count, 3))
    moved = -(turned @ centres[..., None])
    focal = float(max(width, height))
    matrix = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return {
        "image_names": truth.photos["image"].to_numpy(str),
        "pixel_centres": np.array("half"),
        "depth": random.uniform(*_TEMPLATE_DEPTH_M, (count, height, width)).astype(np.float32),
        "conf": random.uniform(0.0, 1.0, (count, height, width)).astype(np.float32),
        "intrinsics": np.tile(matrix, (count, 1, 1)),
        "extrinsics": np.concatenate([turned, moved], axis=2),
    }


def write_alignments(evaluation: Evaluation, path: Path) -> None:
    """Write ``alignment.json``: how each scene was aligned, its scale and its residuals."""
    found = {name: one.facts.get("alignment") for name, one in evaluation.scored.items()}
    values = {name: one for name, one in found.items() if one is not None}
    with atomic_write(path, "w") as stream:
        stream.write(json.dumps(values, indent=1, allow_nan=False) + "\n")


TRACK = ReconstructionTrack()
