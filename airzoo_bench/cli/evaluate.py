"""``airzoo-bench eval``: score predictions."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from airzoo_bench.cli.built import (
    BuiltGroup,
    built_app,
    engine_parameters,
    parameter,
    with_parameters,
)
from airzoo_bench.cli.common import (
    AllOption,
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
from airzoo_bench.cli.locations import DataOption, predictions_here, refuse_one_slash, resolve_data
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import TRACKS, resolve
from airzoo_bench.engines.engine import LOCAL, open_engine

if TYPE_CHECKING:
    from airzoo_bench.evaluation.evaluate import Evaluation
    from airzoo_bench.evaluation.info import EvalOption, TrackInfo
    from airzoo_bench.evaluation.scene_store import SceneStore

OutOption = Annotated[
    str | None,
    typer.Option(
        "--out",
        "-o",
        metavar="PATH|URL",
        help="Folder for result.json and records.csv, in place of an earlier run's; at s3://, "
        "gs:// or hf:// too.",
    ),
]
MethodOption = Annotated[
    str | None,
    typer.Option(help="The method's name in tables (default: the name of --out, else the file's)."),
]


class _EvalGroup(BuiltGroup):
    registry = TRACKS
    own_panel = "Figures and checks"
    panels: ClassVar[dict[str, tuple[str, ...]]] = {
        "Predictions": ("protocol", "data", "reader", "names", "image_size"),
        "Output": ("out", "method", "form", "every_score"),
    }

    def command_of(self, thing: TrackInfo) -> tuple[Callable[..., None], str, str]:
        about = typer.Argument(metavar="PREDICTIONS", help=f"{thing.argument} A path or a URL.")
        parameters = [
            parameter("predictions", Annotated[str, about]),
            parameter("protocol", ProtocolOption, None),
            parameter("data", DataOption, None),
            parameter("out", OutOption, None),
            parameter("reader", ReaderOption, None),
            parameter("names", NamesOption, None),
            *[parameter("image_size", ImageSizeOption, None)] * thing.takes_image_size,
            parameter("method", MethodOption, None),
            parameter("form", FormatOption, Format.TERMINAL),
            parameter("every_score", AllOption, False),
            *(parameter(one.name, _kind(one), one.default) for one in thing.options),
            *engine_parameters(thing.jobs),
            parameter("max_memory", MemoryOption, "2G"),
            parameter("untrusted", UntrustedOption, False),
            parameter("resume", ResumeOption, False),
        ]
        command = with_parameters(partial(_evaluate, thing), parameters, thing.summary)
        call = f"eval {thing.name} {thing.example}"
        return command, call, f"{call} --engine dask --jobs 8"


app = built_app(_EvalGroup, "Score predictions and print the per-scene table.")


def _kind(one: EvalOption) -> Any:
    if isinstance(one.default, bool):
        return Annotated[bool, typer.Option(f"--{one.name}", help=one.help)]
    return Annotated[int, typer.Option(f"--{one.name}", min=1, max=one.most, help=one.help)]


def _evaluate(
    track: TrackInfo,
    predictions: str,
    protocol: str | None,
    data: str | None,
    out: str | None,
    reader: str | None,
    names: Path | None,
    method: str | None,
    form: Format,
    every_score: bool,
    jobs: int,
    max_memory: str,
    untrusted: bool,
    engine: str,
    resume: bool,
    image_size: str | None = None,
    **extras: bool | int,
) -> None:
    from airzoo_bench.core.sandbox import Limits
    from airzoo_bench.evaluation.evaluate import evaluate
    from airzoo_bench.evaluation.opening import ReadBy
    from airzoo_bench.evaluation.run_files import check_run_folder, only_run_at
    from airzoo_bench.evaluation.track import Run

    asked = {one: extras[one.name] for one in track.options if extras[one.name] != one.default}
    writing = [f"--{one.name}" for one in asked if one.needs_out]
    if out is None and (writing or resume):
        what = " and ".join([*writing, *["--resume"] * resume])
        raise UsageError(f"{what}: a folder to write into is needed", fix="add --out DIR")
    name = method
    if out is not None:
        refuse_one_slash(out)
        check_run_folder(out, [one for one in (predictions, protocol, data, names) if one])
        name = method or Path(out).resolve().name or None
    memory = memory_bytes(max_memory)
    with (
        only_run_at(out),
        open_engine(engine, jobs=jobs, memory_bytes=memory, note=say) as place,
        _keep_scenes(out if resume and not writing else None) as store,
    ):
        place.progress = progress
        threads = jobs if engine == LOCAL else 1
        limits = Limits(memory) if untrusted else None
        run = Run(memory, threads, progress, bool(writing), place, limits)
        evaluation = evaluate(
            predictions_here(predictions),
            data=resolve_data(data),
            track=track.name,
            protocol=protocol,
            method=name,
            run=run,
            read_by=ReadBy(reader, names, image_size),
            begun=partial(_say_replaced, out),
            store=store,
        )
        if evaluation.given.reader is not None:
            say(f"read by reader {evaluation.given.reader.name}: `airzoo-bench check` says how")
        written = [] if out is None else _save(evaluation, out, partial(_act, asked, run))
        _print_result(evaluation, form, every_score=every_score)
        for line in _act(asked, run, evaluation, None):
            say(line)
    if method is None and name is not None:
        say(f"the method is called {name}, after --out; --method gives it another name")
    if not written:
        say("nothing was written; add --out DIR to keep the result and its records")
        return
    *others, last = map(str, written)
    say(f"wrote {', '.join(others)} and {last}")
    say(f"next: airzoo-bench table {written[0]} --format latex")


@contextmanager
def _keep_scenes(out: str | None) -> Iterator[SceneStore | None]:
    """Open the store of scored scenes beside an output; remove it when the block is done."""
    from airzoo_bench.evaluation.run_files import local_place
    from airzoo_bench.evaluation.scene_store import SceneStore

    beside = local_place(out)
    if beside is None:
        yield None
        return
    store = SceneStore(beside.with_name(f"{beside.name}.unfinished"))
    if store.paths():
        say(f"{store.folder} holds scored scenes, which are used where they are of this very run")
    else:
        say("no scene of an earlier run is kept: all begins anew")
    try:
        yield store
    except KeyboardInterrupt:
        if store.paths():
            say(f"scored scenes are kept in {store.folder}; the same command goes on from there")
        raise
    store.remove()


def _say_replaced(out: str | None) -> None:
    """Say which earlier run will go: once the predictions are known to be scored."""
    from airzoo_bench.evaluation.run_files import describe_earlier_run

    if out is not None and (replaced := describe_earlier_run(out)) is not None:
        say(replaced)


def _act(
    asked: dict[EvalOption, Any], run: Any, done: Evaluation, folder: Path | None
) -> Iterator[str]:
    """Do what a track's own options ask for: within the run's folder, or without one."""
    for one, value in asked.items():
        if one.needs_out == (folder is not None):
            yield from resolve(one.act)(done, value, folder, run)


def _save(
    evaluation: Evaluation, out: str, act: Callable[[Evaluation, Path], Iterator[str]]
) -> list[Path]:
    """Write the files of the run, and say what was drawn."""
    from airzoo_bench.evaluation.run_files import run_folder, save

    lines: list[str] = []
    with run_folder(out) as folder:

        def draw(staged: Path) -> None:
            lines.extend(line.replace(str(staged), str(folder)) for line in act(evaluation, staged))

        written = save(evaluation, folder, draw)
    for line in lines:
        say(line)
    return written


def _print_result(evaluation: Evaluation, form: Format, *, every_score: bool) -> None:
    from airzoo_bench.tables.layouts import scenes_table

    result = evaluation.result
    if form is Format.JSON:
        content = json.loads(result.model_dump_json(by_alias=True))
        put(json.dumps(content, indent=1) + "\n")
    else:
        show(scenes_table(result, every_score=every_score, floors=True), form)
