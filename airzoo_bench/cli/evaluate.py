"""``airzoo-bench eval``: score predictions."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from airzoo_bench.cli.built import (
    BuiltGroup,
    Command,
    built_app,
    engine_parameters,
    parameter,
    with_parameters,
)
from airzoo_bench.cli.common import (
    Format,
    FormatOption,
    ImageSizeOption,
    MemoryOption,
    NamesOption,
    ProtocolOption,
    ReaderOption,
    ResumeOption,
    UntrustedOption,
    memory_bytes,
    progress,
    put,
    say,
    show,
)
from airzoo_bench.cli.locations import DataOption, predictions_here, resolve_data
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import TRACKS, resolve
from airzoo_bench.engines.engine import LOCAL, open_engine

if TYPE_CHECKING:
    from airzoo_bench.evaluation.evaluate import Evaluation
    from airzoo_bench.evaluation.info import TrackInfo
    from airzoo_bench.evaluation.run_files import SceneStore

OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        help="Folder for result.json and records.csv, which replace an earlier run's.",
    ),
]
MethodOption = Annotated[
    str | None,
    typer.Option(help="The method's name in tables (default: the name of --out, else the file's)."),
]


class _EvalGroup(BuiltGroup):
    registry = TRACKS
    panels: ClassVar[dict[str, tuple[str, ...]]] = {
        "Predictions": ("protocol", "data", "reader", "names", "image_size"),
        "Output": ("out", "method", "form", "figures", "clouds"),
    }

    def command_of(self, thing: TrackInfo) -> tuple[Command, str, str]:
        about = typer.Argument(metavar="PREDICTIONS", help=f"{thing.argument} Path or URL.")
        own = {one.name: typer.Option(f"--{one.name}", help=one.help) for one in thing.options}
        parameters = [
            parameter("predictions", Annotated[str, about]),
            parameter("protocol", ProtocolOption, None),
            parameter("data", DataOption, None),
            parameter("reader", ReaderOption, None),
            parameter("names", NamesOption, None),
            *[parameter("image_size", ImageSizeOption, None)] * thing.takes_image_size,
            parameter("out", OutOption, None),
            parameter("method", MethodOption, None),
            parameter("form", FormatOption, Format.TERMINAL),
            *(parameter(name, Annotated[bool, option], False) for name, option in own.items()),
            *engine_parameters(thing.jobs),
            parameter("max_memory", MemoryOption, "2G"),
            parameter("untrusted", UntrustedOption, False),
            parameter("resume", ResumeOption, False),
        ]
        command = with_parameters(partial(_evaluate, thing), parameters, thing.summary)
        call = f"eval {thing.name} {thing.example}"
        return command, call, f"{call} --engine dask --jobs 8"


app = built_app(_EvalGroup, "Score predictions and print the per-scene table.")


def _evaluate(
    track: TrackInfo,
    predictions: str,
    protocol: str | None,
    data: str | None,
    reader: str | None,
    names: Path | None,
    out: Path | None,
    method: str | None,
    form: Format,
    jobs: int,
    engine: str,
    max_memory: str,
    untrusted: bool,
    resume: bool,
    image_size: str | None = None,
    **writing: bool,
) -> None:
    from airzoo_bench.core.sandbox import Limits
    from airzoo_bench.evaluation.evaluate import evaluate
    from airzoo_bench.evaluation.opening import ReadBy
    from airzoo_bench.evaluation.run_files import check_run_folder
    from airzoo_bench.evaluation.track import Run
    from airzoo_bench.tables.layouts import scenes_table

    asked = [one for one in track.options if writing[one.name]]
    if out is None and (asked or resume):
        flags = " and ".join([f"--{one.name}" for one in asked] + ["--resume"] * resume)
        raise UsageError(f"{flags}: a folder to write into is needed", fix="add --out DIR")
    if out is not None:
        check_run_folder(out, predictions)
        method = method or out.resolve().name or None
    memory = memory_bytes(max_memory)
    with (
        open_engine(engine, jobs=jobs) as place,
        _keep_scenes(out if resume and not asked else None) as store,
    ):
        place.progress = progress
        threads = jobs if engine == LOCAL else 1
        limits = Limits(memory) if untrusted else None
        run = Run(memory, threads, progress, bool(asked), place, limits)
        evaluation = evaluate(
            predictions_here(predictions),
            data=resolve_data(data),
            track=track.name,
            protocol=protocol,
            method=method,
            run=run,
            read_by=ReadBy(reader, names, image_size),
            begun=partial(_say_replaced, out),
            store=store,
        )
        if evaluation.given.reader is not None:
            say(f"read by reader {evaluation.given.reader.name}: `airzoo-bench check` says how")
        if out is not None:
            written = _save(evaluation, out, asked, run)
    if form is Format.JSON:
        content = json.loads(evaluation.result.model_dump_json(by_alias=True))
        put(json.dumps(content, indent=1) + "\n")
    else:
        show(scenes_table(evaluation.result, floors=True), form)
    if out is None:
        say("nothing was written; add --out DIR to keep the result and its records")
    else:
        say(f"wrote {', '.join(map(str, written))} of method {method}")
        say(f"next: airzoo-bench table {written[0]} --format latex")


@contextmanager
def _keep_scenes(out: Path | None) -> Iterator[SceneStore | None]:
    """Open the store of scored scenes beside an output; remove it when the block is done."""
    from airzoo_bench.evaluation.run_files import SceneStore

    if out is None:
        yield None
        return
    beside = out.resolve()
    store = SceneStore(beside.with_name(f"{beside.name}.unfinished"))
    if store.paths():
        say(f"{store.folder} holds scored scenes, which are used where they are of this very run")
    try:
        yield store
    except KeyboardInterrupt:
        if store.paths():
            say(f"scored scenes are kept in {store.folder}; the same command goes on from there")
        raise
    store.remove()


def _say_replaced(out: Path | None) -> None:
    """Say that an earlier run will go, once the predictions are known to be scored."""
    if out is not None and (out / "result.json").exists():
        say(f"{out} holds a run; this one takes its place")


def _save(evaluation: Evaluation, out: Path, asked: list[Any], run: Any) -> list[Path]:
    """Write the files of the run, and those that a track's own options ask for."""
    from airzoo_bench.evaluation.run_files import save

    lines: list[str] = []

    def draw(staged: Path) -> None:
        for one in asked:
            for line in resolve(one.act)(evaluation, True, staged, run):
                lines.append(line.replace(str(staged), str(out)))

    written = save(evaluation, out, draw)
    for line in lines:
        say(line)
    return written
