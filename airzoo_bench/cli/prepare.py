"""``airzoo-bench prepare``: native data become a benchmark folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from airzoo_bench.cli.built import BuiltGroup, option_parameters, parameter, with_parameters
from airzoo_bench.cli.common import JobsOption, progress, put, say, with_data
from airzoo_bench.core.places import data_root
from airzoo_bench.core.plurals import counted
from airzoo_bench.core.registry import DATASETS, TRACKS
from airzoo_bench.datasets.dataset import Dataset, Prepared, PrepareSettings

if TYPE_CHECKING:
    from airzoo_bench.datasets.scene_facts import SceneFacts
    from airzoo_bench.datasets.truths import SceneTruths

__all__ = ["app"]


class Parts(StrEnum):
    """Where parts of the map are."""

    WINDOWS = "windows"
    FILES = "files"


OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="The folder to make (default: in the data root)."),
]
TilesOption = Annotated[
    Parts, typer.Option(help="Leave tiles as windows of the map, or write them as PNG too.")
]
CropsOption = Annotated[
    Parts, typer.Option(help="Leave crops as windows, or write them as GeoTIFF too.")
]
CopyOption = Annotated[
    bool, typer.Option("--copy", help="Copy photos, maps and clouds into the folder.")
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace the folder.")]


class _PrepareGroup(BuiltGroup):
    registry = DATASETS
    panels: ClassVar[dict[str, tuple[str, ...]]] = {
        "Sources": (
            *("name", "images", "poses", "dom", "dsm", "cloud", "priors", "crs"),
            *("vertical_crs", "priors_vertical_crs", "dsm_vertical_crs", "truth_accuracy"),
        ),
        "What is measured": (
            *("protocol", "matching_protocol", "reconstruction_protocol"),
            *("tile_size", "rule", "iou_above"),
        ),
        "Output": ("out", "tiles", "crops", "copy", "force"),
    }

    def command_of(self, thing: Dataset[Any]) -> tuple[Callable[..., None], str]:
        parameters = [
            *option_parameters(thing.options),
            parameter("out", OutOption, None),
            parameter("tiles", TilesOption, Parts.WINDOWS),
            parameter("crops", CropsOption, Parts.WINDOWS),
            parameter("copy", CopyOption, False),
            parameter("force", ForceOption, False),
            *([] if thing.jobs is None else [parameter("jobs", JobsOption, thing.jobs)]),
        ]
        command = with_parameters(partial(_prepare, thing), parameters, thing.summary)
        return command, f"prepare {thing.example}"


app = typer.Typer(
    cls=_PrepareGroup, help="Make a benchmark folder out of data.", no_args_is_help=True
)


@app.callback()
def _group() -> None:
    """Make a benchmark folder out of data."""


def _prepare(
    dataset: Dataset[Any],
    out: Path | None,
    tiles: Parts,
    crops: Parts,
    copy: bool,
    force: bool,
    jobs: int = 1,
    **options: Any,
) -> None:
    from airzoo_bench.core.files import check_new_folder

    chosen, root = dataset.options(**options), data_root()
    folder = out or root / dataset.benchmark(chosen)
    check_new_folder(folder, replace=force)
    settings = PrepareSettings(
        folder,
        root,
        tiles_on_disk=tiles is Parts.FILES,
        crops_on_disk=crops is Parts.FILES,
        copy=copy,
        replace=force,
        jobs=jobs,
        progress=progress,
        note=say,
    )
    prepared = dataset.prepare(chosen, settings)
    put(f"{prepared.folder}\n")
    for scene, truths in prepared.truths.items():
        _print_scene(dataset, prepared, scene, truths)
    for facts in prepared.facts.values():
        _warn(facts)
    for protocol, track in prepared.protocols.items():
        file = f"{track}{Path(TRACKS.get(track).baseline.out).suffix}"
        say(f"next: airzoo-bench baseline {track} {protocol}{with_data(out)} --out {file}")


def _print_scene(
    dataset: Dataset[Any], prepared: Prepared, scene: str, truths: SceneTruths
) -> None:
    facts = prepared.facts.get(scene)
    if facts is None or len(prepared.truths) > 1:
        put(f"{scene}, {counted(len(truths.photos), 'photo')}\n")
    if facts is not None:
        from airzoo_bench.datasets.facts_lines import fact_lines

        for line in fact_lines(facts):
            put(f"  {line}\n")
    _print_tracks(truths, dataset.without_truth)


def _print_tracks(truths: SceneTruths, without_truth: Mapping[str, str]) -> None:
    if truths.retrieval is not None:
        truth = truths.retrieval.truth
        counts = truth.positives.counts
        text = f"{counted(len(truth.queries), 'query')}, {counted(len(truth.tiles), 'tile')}, "
        text += f"{counts.min()} to {counts.max()} positives per query, mean {counts.mean():.1f}"
        _print_track("retrieval", text, len(truth.excluded))
    if truths.matching is not None:
        text = f"{counted(len(truths.matching.queries), 'query')} with a prior"
        _print_track("matching", text, len(truths.matching.excluded))
    if truths.reconstruction is not None:
        text = f"{counted(len(truths.reconstruction.photos), 'photo')}, a true cloud"
        _print_track("reconstruction", text)
    for track, reason in without_truth.items():
        if getattr(truths, track) is None:
            _print_track(track, f"no: {reason}")


def _print_track(track: str, text: str, left_out: int = 0) -> None:
    put(f"  {track:15} {text}\n")
    if left_out:
        put(f"  {'':15} {counted(left_out, 'photo')} left out; excluded.csv says why\n")


def _warn(facts: SceneFacts) -> None:
    from airzoo_bench.core.errors import first_of
    from airzoo_bench.datasets.facts_lines import plausibility_warnings

    for sentence in plausibility_warnings(facts):
        say(f"warning: {sentence}")
    if facts.inputs.unposed:
        listed = first_of(map(repr, facts.inputs.unposed))
        say(f"photos without a pose, which no track asks: {listed}")
