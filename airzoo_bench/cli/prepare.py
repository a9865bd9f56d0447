"""``airzoo-bench prepare``: native data become a benchmark folder."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from airzoo_bench.cli.built import (
    BuiltGroup,
    Command,
    built_app,
    engine_parameters,
    option_parameters,
    parameter,
    with_parameters,
)
from airzoo_bench.cli.common import progress, put, say, working
from airzoo_bench.cli.locations import with_data
from airzoo_bench.core.errors import counted
from airzoo_bench.core.files import data_root
from airzoo_bench.core.registry import DATASETS, TRACKS
from airzoo_bench.datasets.about import About, about_file, about_of
from airzoo_bench.engines.engine import LOCAL, Processes, open_engine

if TYPE_CHECKING:
    from airzoo_bench.datasets.dataset import Dataset
    from airzoo_bench.datasets.settings import Prepared, SceneSummary


class Parts(StrEnum):
    """Where parts of the map are."""

    WINDOWS = "windows"
    FILES = "files"


def _option(kind: Any, help_text: str, *names: str) -> Any:
    return Annotated[kind, typer.Option(*names, help=help_text)]


_OUTPUT = (
    parameter(
        "out",
        _option(Path | None, "The folder to make (default: in the data root).", "--out", "-o"),
        None,
    ),
    parameter(
        "tiles",
        _option(Parts, "Leave tiles as windows of the map, or write them as PNG too."),
        Parts.WINDOWS,
    ),
    parameter(
        "crops",
        _option(Parts, "Leave crops as windows, or write them as GeoTIFF too."),
        Parts.WINDOWS,
    ),
    parameter(
        "copy", _option(bool, "Copy photos, maps and clouds into the folder.", "--copy"), False
    ),
    parameter("force", _option(bool, "Replace the folder.", "--force"), False),
)


class _PrepareGroup(BuiltGroup):
    registry = DATASETS
    own_panel = "How it is read"
    panels: ClassVar[dict[str, tuple[str, ...]]] = {
        "Sources": (
            *("source", "scene", "keep_going", "name", "images", "poses"),
            *("dom", "dsm", "cloud", "priors", "crs", "truth_accuracy"),
        ),
        "What is measured": (
            *("protocol", "matching_protocol", "reconstruction_protocol"),
            *("tile_size", "rule", "iou_above", "plane_height"),
        ),
        "Output": ("out", "tiles", "crops", "copy", "force"),
    }

    def summary_of(self, name: str) -> str:
        """Return the summary, without importing a built-in dataset."""
        about = about_of(name) if about_file(name).is_file() else DATASETS.get(name).about
        return str(about.summary)

    def command_of(self, thing: Dataset[Any]) -> tuple[Command, str]:
        about = thing.about
        parameters = [*option_parameters(thing.options, about.options), *_OUTPUT]
        if thing.jobs is not None:  # a process a scene, or a photo of airzoo-mini
            parameters += engine_parameters(thing.jobs)
        data = f"\n\nData: {about.page}\n\nLicence: {about.licence}." if about.is_published else ""
        command = with_parameters(partial(_prepare, thing), parameters, f"{about.summary}{data}")
        return command, f"prepare {about.example}"


app = built_app(_PrepareGroup, "Make a benchmark folder out of data.")


def _prepare(
    dataset: Dataset[Any],
    out: Path | None,
    tiles: Parts,
    crops: Parts,
    copy: bool,
    force: bool,
    jobs: int = 1,
    engine: str = LOCAL,
    **options: Any,
) -> None:
    from airzoo_bench.core.files import check_new_folder
    from airzoo_bench.datasets.settings import PrepareSettings

    chosen, root = dataset.options(**options), data_root()
    with working("getting ready"):
        folder = out or root / dataset.folder_name(chosen, root)
        settings = PrepareSettings(
            folder,
            root,
            tiles_on_disk=tiles is Parts.FILES,
            crops_on_disk=crops is Parts.FILES,
            copy=copy,
            replace=force,
            progress=progress,
            note=say,
        )
        there = not force and dataset.is_prepared(chosen, settings)
    if there:
        put(f"{folder}\n")
        say("nothing to do: it is complete, its checksums are right, and its sources are unchanged")
        return
    check_new_folder(folder, replace=force)
    with open_engine(engine, jobs=jobs, here=Processes(jobs)) as place:
        prepared = dataset.prepare(chosen, replace(settings, engine=place))
    _print_prepared(dataset.about, prepared)
    for protocol, track in prepared.protocols.items():
        file = f"{track}{Path(TRACKS.get(track).baseline.out).suffix}"
        where = with_data(None if prepared.folder.parent == root else prepared.folder)
        say(f"next: airzoo-bench baseline {track} {protocol}{where} --out {file}")
    if prepared.failed:
        raise typer.Exit(1)


def _print_prepared(about: About, prepared: Prepared) -> None:
    put(f"{prepared.folder}\n")
    lines = [f"licence: {about.licence}"] * bool(about.licence)
    lines += [f"assumed: {sentence}" for sentence in about.assumptions]
    lines += [f"not verified: {sentence}" for sentence in about.unverified]
    put("".join(f"  {line}\n" for line in lines))
    several = len(prepared.summaries) > 1
    for scene, summary in prepared.summaries.items():
        _print_scene(scene, summary, about.without_truth, several)
    for scene, summary in prepared.summaries.items():
        for sentence in (*(f"warning: {one}" for one in summary.warnings), *summary.notes):
            # Some begin so: "flight 07: ...".
            named = re.match(rf"(warning: )?\w+ {re.escape(scene)}\b", sentence) or not several
            say(sentence if named else f"scene {scene}: {sentence}")
    for scene, why in prepared.failed.items():
        say(f"left out, scene {scene}: {why}")


def _print_scene(
    scene: str, summary: SceneSummary, reasons: Mapping[str, str], several: bool
) -> None:
    if not summary.facts or several:
        put(f"{scene}, {counted(summary.photos, 'photo')}\n")
    lines = [*summary.facts]
    for track, found in summary.tracks.items():
        lines.append(f"{track:15} {found.text}")
        if found.left_out:
            left_out = counted(found.left_out, "photo")
            lines.append(f"{'':15} {left_out} left out; excluded.csv says why")
    missing = [track for track in reasons if track not in summary.tracks]
    lines += [f"{track:15} no: {reasons[track]}" for track in missing]
    put("".join(f"  {line}\n" for line in lines))
