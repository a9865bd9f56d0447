"""The reconstruction track: photos become a cloud."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, UnreadableError, UsageError, first_of
from airzoo_bench.evaluation.parts import EvalOption, Resources
from airzoo_bench.evaluation.track import Track
from airzoo_bench.formats.archives import ARCHIVE_SUFFIXES
from airzoo_bench.formats.clouds.suffixes import KINDS, SUFFIXES
from airzoo_bench.reconstruction.baseline_settings import STRUCTURE_FROM_MOTION

if TYPE_CHECKING:
    import pandas as pd

    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.evaluation.evaluate import Evaluation
    from airzoo_bench.reconstruction.predictions import ListedScenes, ReconstructionPredictions
    from airzoo_bench.reconstruction.scoring import ScoredScene
    from airzoo_bench.reconstruction.settings import ReconstructionProtocol
    from airzoo_bench.reconstruction.truth import ReconstructionTruth
    from airzoo_bench.results.scores import Score

__all__ = ["TRACK", "ReconstructionTrack"]

_UNPACKED_BYTES = 1 << 40


def _write_alignments(evaluation: Evaluation, path: Path) -> None:
    from airzoo_bench.reconstruction.alignment import write_alignments

    found = {name: scene.alignment for name, scene in evaluation.scored.items()}
    write_alignments({name: one for name, one in found.items() if one is not None}, path)


class ReconstructionTrack(
    Track[
        "ReconstructionProtocol",
        "ReconstructionPredictions",
        "ReconstructionTruth",
        "ListedScenes",
        "ReconstructionPredictions",
        "ScoredScene",
    ]
):
    """Multi-view reconstruction; see `Track`. All scenes share the listed predictions."""

    name = "reconstruction"
    unit = "scene"
    summary = (
        "Score multi-view reconstruction: Chamfer distance, F1, precision and recall, by scene."
    )
    kinds = f"a folder, an archive, or {KINDS}"
    suffixes = (*SUFFIXES, *ARCHIVE_SUFFIXES)
    fields = ("depth", "world_points", "points")
    folders = True
    says_protocol = (
        "protocol.txt in the folder or archive, or a field 'protocol' in a file alone",
        "name it with --protocol; `airzoo-bench protocols` lists them",
    )
    argument = (
        "A folder or archive with an entry a scene (cloud, mesh, or .npz of depth or point maps), "
        "or one such file."
    )
    example = "clouds --out results/mymethod --figures"
    options = (
        EvalOption(
            "figures",
            "Draw curves and maps of errors into --out.",
            "airzoo_bench.report.reconstruction:draw_figures",
            files=r".+_(curve|precision|recall)\.png",
        ),
        EvalOption(
            "clouds",
            "Write clouds coloured by their errors into --out.",
            "airzoo_bench.report.reconstruction:write_clouds",
            files=r".+_(precision|recall)\.ply",
        ),
    )
    files = {"alignment.json": _write_alignments}  # noqa: RUF012 - never changed
    baseline = STRUCTURE_FROM_MOTION
    template_out = "template"

    @property
    def protocol(self) -> type[ReconstructionProtocol]:
        """See `Track.protocol`."""
        from airzoo_bench.reconstruction.settings import ReconstructionProtocol

        return ReconstructionProtocol

    @property
    def recorded(self) -> frozenset[str]:
        """See `Track.recorded`."""
        from airzoo_bench.reconstruction.scoring import RECORDED

        return RECORDED

    def read(self, path: Path, memory_bytes: int) -> ReconstructionPredictions:
        """List predictions; see `open_reconstruction`."""
        from airzoo_bench.formats.arrays import open_arrays, protocol_name
        from airzoo_bench.reconstruction.predictions import open_reconstruction

        if path.is_file() and not path.name.lower().endswith(self.suffixes):
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

    def portable(self, predictions: Any) -> Any:
        """See `Track.portable`."""
        from airzoo_bench.reconstruction.untrusted import list_scenes

        return list_scenes(predictions)

    def restored(self, predictions: Any, read_scene: Callable[..., Any]) -> Any:
        """See `Track.restored`."""
        return replace(predictions, read_scene=read_scene)

    def store_scene(self, predictions: Any, folder: Path, **scene: Any) -> Any:
        """See `Track.store_scene`."""
        from airzoo_bench.reconstruction.untrusted import store_scene

        with predictions.opened(**scene) as found:
            return store_scene(found, folder)

    def read_truth(self, benchmark: Benchmark, scene: str) -> ReconstructionTruth:
        """See `truth.read_truth`."""
        from airzoo_bench.reconstruction.truth import read_truth

        return read_truth(benchmark, scene)

    def assign(
        self,
        predictions: ReconstructionPredictions,
        protocol: ReconstructionProtocol,
        truths: Sequence[ReconstructionTruth],
        data: Path,
    ) -> ListedScenes:
        """See `Track.assign`."""
        from airzoo_bench.core.validation import nearest
        from airzoo_bench.reconstruction.predictions import ListedScenes

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
        return ListedScenes(predictions, known)

    def match(
        self,
        predictions: ReconstructionPredictions,
        assigned: ListedScenes,
        truths: Sequence[ReconstructionTruth],
        protocol: ReconstructionProtocol,
        resources: Resources,
    ) -> Iterator[ReconstructionPredictions | PredictionError]:
        """Yield all predictions for each scene: entries are opened one at a time, to be scored."""
        for _ in truths:
            yield predictions

    def score(
        self,
        predicted: ReconstructionPredictions,
        truth: ReconstructionTruth,
        protocol: ReconstructionProtocol,
        resources: Resources,
    ) -> ScoredScene:
        """See `scored_scene` and `score_missing`."""
        from airzoo_bench.reconstruction.scoring import score_missing, scored_scene

        if truth.scene not in predicted.scenes:
            return score_missing(truth.scene, protocol.scores)
        with scored_scene(predicted, truth, protocol, resources) as scored:
            if resources.keep:
                return _kept(scored, predicted.path, resources.limits is None)
            return replace(scored, clouds=None, distances=None)

    def records(
        self, scored: Sequence[ScoredScene], protocol: ReconstructionProtocol
    ) -> pd.DataFrame:
        """Put the records of scenes under each other; missing poses are the worst."""
        import pandas as pd

        from airzoo_bench.reconstruction.scoring import worst_poses

        records = pd.DataFrame([scene.record for scene in scored])
        counted = {name for scene in scored for name in scene.counts} & set(records)
        records = records.astype(dict.fromkeys(sorted(counted), "Int64"))
        # A scene without poses, where others have some, has failed.
        return records.fillna(worst_poses(protocol.scores)) if _with_poses(scored) else records

    def read_while_scoring(self, truth: ReconstructionTruth) -> tuple[Path, ...]:
        """Return the true cloud."""
        return (truth.cloud,)

    def scores(
        self, protocol: ReconstructionProtocol, scored: Sequence[ScoredScene]
    ) -> list[Score]:
        """See `reconstruction_scores`."""
        from airzoo_bench.reconstruction.scoring import reconstruction_scores

        return reconstruction_scores(protocol.scores, with_poses=_with_poses(scored))

    def kind(self, predictions: ReconstructionPredictions, scored: Sequence[ScoredScene]) -> str:
        """See `Track.kind`."""
        return ", ".join(sorted({scene.kind for scene in scored if scene.kind is not None}))

    def method(self, path: Path) -> str:
        """See `Track.method`."""
        return path.stem if path.is_file() else path.name

    def notes(
        self,
        predictions: ReconstructionPredictions,
        protocol: ReconstructionProtocol,
        truths: Sequence[ReconstructionTruth],
        scene_predictions: Sequence[ReconstructionPredictions],
        scored: Sequence[ScoredScene],
    ) -> list[str]:
        """See `scored_scene`."""
        return [note for scene in scored for note in scene.notes]

    def inspect(
        self,
        predicted: ReconstructionPredictions,
        truth: ReconstructionTruth,
        protocol: ReconstructionProtocol,
        resources: Resources,
    ) -> list[str]:
        """Score the scene, since only that finds all that scoring would refuse."""
        from airzoo_bench.reconstruction.scoring import read_through

        if truth.is_sealed:
            if truth.scene not in predicted.scenes:
                return []
            return list(read_through(predicted, truth.scene, protocol, resources.memory_bytes))
        return list(self.score(predicted, truth, protocol, resources).notes)

    def inspect_alone(
        self,
        predictions: ReconstructionPredictions,
        protocol: ReconstructionProtocol,
        resources: Resources,
    ) -> Iterator[PredictionError | str]:
        """See `read_through`."""
        from airzoo_bench.reconstruction.scoring import read_through

        for scene in protocol.scenes:
            if scene.id in predictions.scenes:
                try:
                    yield from read_through(predictions, scene.id, protocol, resources.memory_bytes)
                except PredictionError as error:
                    yield error

    def check_template_path(self, out: Path, *, force: bool) -> None:
        """See `Track.check_template_path`."""
        if out.suffix == ".npz" or out.is_file() or (out.is_dir() and any(out.iterdir())):
            what = "is there and not empty" if out.exists() else "is the name of a file"
            raise UsageError(
                f"templates of reconstruction are written as a folder, and this {what}",
                where=out,
                expected="a new folder, such as preds",
                fix="name another with --out",
            )

    def write_template(
        self,
        out: Path,
        protocol: ReconstructionProtocol,
        truths: Sequence[ReconstructionTruth],
        kind: str,
        seed: int,
    ) -> None:
        """Write a folder with random depth maps of each scene."""
        from airzoo_bench.core.files import atomic_write, write_npz
        from airzoo_bench.reconstruction.template import depth_template

        for number, truth in enumerate(truths):
            with atomic_write(out / f"{truth.scene}.npz") as stream:
                write_npz(stream, depth_template(truth, seed + number))
        with atomic_write(out / "protocol.txt", "w") as text:
            text.write(protocol.name + "\n")


def _with_poses(scored: Sequence[ScoredScene]) -> bool:
    return any("ate_m" in scene.record for scene in scored)


def _kept(scene: ScoredScene, path: Path, trusted: bool) -> ScoredScene:
    """Return the scene with clouds that can be read once the predictions are closed."""
    if (trusted and path.is_dir()) or scene.clouds is None:
        return scene
    predicted, true = scene.clouds
    return replace(scene, clouds=(predicted.in_memory(), true))


TRACK = ReconstructionTrack()
