"""``airzoo-bench prepare``: native data become a benchmark folder."""

from __future__ import annotations

import re
from dataclasses import MISSING, fields, replace
from inspect import Parameter, Signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import typer

from airzoo_bench.cli import common as cli
from airzoo_bench.cli.data import about_lines, find_about
from airzoo_bench.core.errors import UsageError, counted
from airzoo_bench.core.files import MARK, check_new_folder, data_root
from airzoo_bench.core.registry import DATASETS, TRACKS
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.settings import OPTIONS, PrepareSettings
from airzoo_bench.engines.engine import LOCAL, open_engine

if TYPE_CHECKING:
    from airzoo_bench.datasets.settings import Prepared

_SOURCES = "source scene name images poses dom dsm cloud priors crs truth-accuracy"
_MEASURED = (
    "protocol matching-protocol reconstruction-protocol tile-size rule iou-above plane-height"
)
_PANELS = dict.fromkeys(_SOURCES.split(), "Sources")
_PANELS |= dict.fromkeys(_MEASURED.split(), "What is measured")

Parts = Literal["windows", "files"]


class _PrepareGroup(cli.LightGroup):
    """A command for each dataset, made when it is called; built-in ones are imported when run."""

    def list_commands(self, ctx: Any) -> list[str]:
        return DATASETS.names()

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the datasets, without importing built-in ones."""
        with formatter.section("Commands"):
            found = {name: getattr(find_about(name), "summary", "") for name in DATASETS.names()}
            formatter.write_dl([(name, text.partition("\n\n")[0]) for name, text in found.items()])

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of a dataset."""
        if cmd_name not in DATASETS:  # which does not look at all packages, as its names do
            return None
        app = typer.Typer(add_completion=False)
        app.command(cmd_name, cls=cli.PanelCommand)(_command_of(cmd_name))
        return typer.main.get_command(app)


app = typer.Typer(
    cls=_PrepareGroup, help="Make a benchmark folder out of data.", no_args_is_help=True
)
app.callback()(lambda: None)


def _command_of(name: str) -> Any:
    """Return a function with the options of a dataset, by the texts of its about-file."""

    def command(**given: Any) -> None:
        _prepare(name, **given)

    options, own = OPTIONS.get(name) or DATASETS.get(name).options, []
    about: Any = find_about(name)
    hints = get_type_hints(options)
    for field in fields(options):
        text, default = about.options[field.name.replace("_", "-")], field.default
        flag = f"--{text.name}/--no-{text.name}" if default is True else f"--{text.name}"
        bounds = {} if hints[field.name] is bool else {"min": text.least, "max": text.most}
        panel = _PANELS.get(text.name, "How it is read")
        text_of = cli.option(text.help, flag, panel=panel, **bounds)
        own.append(
            Parameter(
                field.name,
                Parameter.KEYWORD_ONLY,
                default=Parameter.empty if default is MISSING else default,
                annotation=Annotated[hints[field.name], text_of],
            )
        )
    for one in Signature.from_callable(_prepare, eval_str=True).parameters.values():
        if one.kind is Parameter.KEYWORD_ONLY:
            own.append(one)
    data = f"\n\nData: {about.page}\n\nLicence: {about.licence}." if about.is_published else ""
    command.__doc__ = f"{about.summary}{data}\n\nExample: airzoo-bench prepare {about.example}"
    command.__signature__ = Signature(own)  # type: ignore[attr-defined]
    command.__annotations__ = {one.name: one.annotation for one in own}
    return command


def _prepare(
    name: str,
    /,
    *,
    out: Annotated[
        cli.File,
        cli.option(
            "The folder to make (default: in the data root).", "--out", "-o", panel="Output"
        ),
    ] = None,
    tiles: Annotated[
        Parts,
        cli.option("Leave tiles as windows of the map, or write them as PNG too.", panel="Output"),
    ] = "windows",
    crops: Annotated[
        Parts, cli.option("Leave crops as windows, or write them as GeoTIFF too.", panel="Output")
    ] = "windows",
    copy: Annotated[
        bool, cli.option("Copy photos, maps and clouds into the folder.", "--copy", panel="Output")
    ] = False,
    force: Annotated[bool, cli.option("Replace the folder.", "--force", panel="Output")] = False,
    jobs: cli.JobsOption = None,
    engine: cli.EngineOption = LOCAL,
    **options: Any,
) -> None:
    for option, path in options.items():
        if isinstance(path, Path) and not path.exists():
            fix = f"correct --{option.replace('_', '-')}"
            raise UsageError("no such file or folder", where=path, fix=fix)
    dataset = DATASETS.get(name)
    chosen, root, jobs = dataset.options(**options), data_root(), jobs or dataset.jobs
    with cli.working("getting ready"):
        benchmark = dataset.folder_name(chosen, root)
        folder = out or root / benchmark
        settings = PrepareSettings(
            folder,
            root,
            tiles_on_disk=tiles == "files",
            crops_on_disk=crops == "files",
            copy=copy,
            replace=force,
            progress=cli.progress,
            note=cli.say,
        )
        there = not force and dataset.is_prepared(chosen, settings)
    if there:
        cli.echo(f"{folder}\n")
        cli.say("nothing to do: it is complete and as it was made, and its sources are unchanged")
        return
    check_new_folder(folder, replace=force)
    twin = folder.absolute().with_name(benchmark)
    if folder.name != benchmark and (twin / MARK).exists():
        fix = "choose another --name, or put the folder beside no other of this name"
        raise UsageError(f"{twin} is a benchmark {benchmark} too", where=folder, fix=fix)
    with open_engine(engine, jobs=jobs, processes=jobs) as place:
        prepared = dataset.prepare(chosen, replace(settings, engine=place))
    _print_prepared(dataset.about, prepared)
    for protocol, track in prepared.protocols.items():
        file = f"{track}{Path(TRACKS.get(track).baseline.out).suffix}"
        where = cli.with_data(None if prepared.folder == root / benchmark else prepared.folder)
        cli.say(f"next: airzoo-bench baseline {track} {protocol}{where} --out {file}")


def _print_prepared(about: About, prepared: Prepared) -> None:
    several = len(prepared.summaries) > 1
    cli.echo("".join([f"{prepared.folder}\n", *(f"  {line}\n" for line in about_lines(about))]))
    for scene, summary in prepared.summaries.items():
        if not summary.facts or several:
            cli.echo(f"{scene}, {counted(summary.photos, 'photo')}\n")
        lines = [*summary.facts]
        for track, found in summary.tracks.items():
            lines.append(f"{track:15} {found.text}")
            if found.left_out:
                lines.append(f"{'':15} {counted(found.left_out, 'photo')} left out: excluded.csv")
        lines += [f"{track:15} no: {why}" for track, why in summary.without_truth.items()]
        cli.echo("".join(f"  {line}\n" for line in lines))
    for scene, summary in prepared.summaries.items():
        for sentence in (*(f"warning: {one}" for one in summary.warnings), *summary.notes):
            # Some begin so: "flight 07: ...".
            named = re.match(rf"(warning: )?\w+ {re.escape(scene)}\b", sentence) or not several
            cli.say(sentence if named else f"scene {scene}: {sentence}")
