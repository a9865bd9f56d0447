"""``airzoo-bench download``, ``manifest``, ``protocols``, ``mini``: benchmarks and their data."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from airzoo_bench.cli import common as cli
from airzoo_bench.core.errors import UsageError, counted
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.about import About, about_file, load_about
from airzoo_bench.engines.engine import Engine

if TYPE_CHECKING:
    from airzoo_bench.protocol.model import Protocol

_TITLES = (
    *("Protocol", "Track", "Scenes", "Queries"),
    *("Version", "Fingerprint", "Title", "Data", "Licence", "Assumed"),
)


def download(
    benchmark: Annotated[str, typer.Argument(help="Its name in `prepare`.")],
    to: Annotated[cli.File, cli.option("Folder to put it in (default: its name).")] = None,
    scene: Annotated[cli.Texts, cli.option("Only this scene of airzoo-real, repeatable.")] = None,
) -> None:
    """Fetch a published benchmark from Hugging Face, or list the links to its files.

    Run it again after an interruption: files that are there and whole are not fetched
    again.

    Example: airzoo-bench download NAME

    Example: airzoo-bench download NAME --to /data/NAME --scene 01
    """
    published = {n: one for n in DATASETS.names() if (one := find_about(n)) and one.is_published}
    cli.check_choice("airzoo-bench download", benchmark[:80], list(published))
    about, folder = published[benchmark], to or Path(benchmark)
    if not {*(scene or ())} <= {*about.scene_files}:
        expected = ", ".join(about.scene_files) or "none: it can only be fetched whole"
        raise UsageError("a scene cannot be fetched by itself", where="--scene", expected=expected)
    cli.say(f"{about.title}, licence: {about.licence}")
    if about.repository is None:
        cli.echo("".join(f"{link}\n" for link in about.links or (about.page,)))
        cli.say(f"{about.title} is not on Hugging Face: fetch it by hand, or by wget -c")
        cli.say(f"next: unpack it, then: airzoo-bench prepare {benchmark} --source FOLDER")
        return
    from airzoo_bench.datasets.about import fetch_from_hub, patterns_to_skip

    wanted = (about.repository, patterns_to_skip(about.scene_files, scene or []), folder)
    files = fetch_from_hub(*wanted, dry_run=True)
    sizes = [file.file_size for file in files if file.will_download]
    cli.say(f"{counted(len(sizes), 'file')} to fetch, {sum(sizes) / 1e6:,.3g} MB")
    if sizes and sys.stdin.isatty():
        typer.confirm("Go on?", default=True, abort=True, err=True)
    fetch_from_hub(*wanted, dry_run=False)
    cli.echo(f"{folder}\n")
    cli.say(f"next: airzoo-bench prepare {benchmark} --source {folder}")


def manifest(
    folder: Annotated[Path, typer.Argument(help="Benchmark folder, with benchmark.toml.")],
    force: Annotated[
        bool, cli.option("Replace checksums that differ from the files.", "--force")
    ] = False,
) -> None:
    """Fill in benchmark.toml of a folder made by hand: its checksums, and what else is missing.

    docs/benchmark-folder.md says which files and columns there are.

    Example: airzoo-bench manifest mine
    """
    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.datasets.folder import complete_manifest

    written = complete_manifest(folder, replace=force)
    Benchmark.open(folder)
    cli.echo(f"{folder}\n")
    for sentence in written:
        cli.say(f"written: {sentence}")


def protocols(
    name: Annotated[cli.Text, typer.Argument(help="Print this protocol's file.")] = None,
    data: cli.DataOption = None,
    form: cli.FormatOption = cli.Format.TERMINAL,
) -> None:
    """List the protocols of the package and of prepared benchmark folders.

    With a name, print its file, and licence and assumptions of the benchmark.

    Example: airzoo-bench protocols uav-visloc-retrieval
    """
    from airzoo_bench.protocol.model import find_protocol, load_protocol, protocol_files

    folder = cli.resolve_data(data)
    if name is not None:
        protocol = find_protocol(name, folder)
        path = Path(name) if name.endswith(".toml") else protocol_files(folder)[name]
        # Comments, so that the whole is still a protocol file.
        if about := find_about(protocol.benchmark.removesuffix("-partial")):
            lines = [f"{about.title}: {about.page}".removesuffix(": "), *about_lines(about)]
            cli.echo("".join(f"# {line}\n" for line in lines))
        cli.echo(path.read_text(encoding="utf-8"))
        return
    rows = [_values(key, load_protocol(path)) for key, path in protocol_files(folder).items()]
    few = 4 if form is cli.Format.TERMINAL else None
    if few:
        cli.say("protocols NAME prints one and what is assumed of its data; --format json has all")
    cli.show_rows("Protocols", _TITLES[:few], [row[:few] for row in rows], form)


def _values(key: str, protocol: Protocol) -> tuple[str | int, ...]:
    name = protocol.benchmark.removesuffix("-partial")
    # Published counts are of the whole benchmark, not of what a folder holds of it.
    counts = [s.queries for s in protocol.scenes if s.queries and name == protocol.benchmark]
    queries = sum(counts) if len(counts) == len(protocol.scenes) else ""
    first = (key, protocol.track, len(protocol.scenes), queries)
    about = find_about(name)
    data = (about.page, about.licence, " ".join(about.assumptions)) if about else ("", "", "")
    return (*first, protocol.version, protocol.fingerprint[:12], protocol.title, *data)


def find_about(name: str) -> About | None:
    """Return the description of a dataset of this name, without importing a built-in one."""
    if about_file(name).is_file():
        return load_about(name)
    found: dict[str, About] = {}
    with DATASETS.warning(name):
        found = {name: DATASETS.get(name).about} if name in DATASETS else {}
    return found.get(name)


def about_lines(about: About) -> list[str]:
    """Return what is assumed of a dataset, and not verified."""
    lines = [f"licence: {about.licence}"] * bool(about.licence)
    lines += [f"assumed: {sentence}" for sentence in about.assumptions]
    return lines + [f"not verified: {sentence}" for sentence in about.unverified]


# --- the world of AirZoo-Mini ---


mini = typer.Typer(
    cls=cli.LightGroup, help="Render frames of AirZoo-Mini's world.", no_args_is_help=True
)
mini.callback()(lambda: None)


@mini.command(cls=cli.PanelCommand)
def render(
    out: Annotated[Path, cli.option("The folder to write into.", "--out", "-o")],
    region: Annotated[Literal["city", "rural"], cli.option("The region.")] = "city",
    flight: Annotated[Literal["barrel-roll", "survey"], cli.option("The flight.")] = "barrel-roll",
    weather: Annotated[
        Literal["sunny", "cloudy", "rainy", "foggy", "snowy"], cli.option("The weather.")
    ] = "sunny",
    time_of_day: Annotated[Literal["day", "sunset", "night"], cli.option("The time.")] = "day",
    seed: Annotated[int, cli.option("Another seed makes another world.", min=0)] = 0,
) -> None:
    """Render a flight's key frames: photos, metric depth and poses.

    Prints the maps of the region: orthophoto, surface model, satellite mosaic. A run that was
    stopped goes on: frames that are there are not rendered again.

    Example: airzoo-bench mini render --region rural -o frames
    """
    from airzoo_bench.core.files import data_root
    from airzoo_bench.datasets.geometry_checks import key_frames
    from airzoo_bench.datasets.mini import flights, renderer
    from airzoo_bench.datasets.mini.dataset import make_worlds
    from airzoo_bench.datasets.mini.world import REGIONS, load_world

    place, camera, engine = REGIONS[region], renderer.default_camera(), Engine(2)
    (made,) = make_worlds([place], data_root(), seed, engine, cli.progress)
    cli.echo("".join(f"{made / name}.tif\n" for name in ("dom", "dsm", "satellite")))
    ground_m, floor_m = flights.flight_levels(load_world(made).dsm)
    flown = flights.survey(place, ground_m, floor_m)
    if flight == "barrel-roll":
        flown = flights.barrel_roll(place, floor_m, seed)
    keys = key_frames(flown, camera, ground_m, 0.5)
    frames = renderer.FrameList(
        names=tuple(f"{frame:06d}" for frame in keys),
        camera=camera,
        poses=flown.take(keys),
        weather=(weather,) * len(keys),
        time_of_day=(time_of_day,) * len(keys),
        seed=seed,
    )
    renderer.render_frames(frames, made, out, engine, cli.progress)
    cli.say(f"{counted(len(keys), 'frame')} in {out}: frames.csv, images/, depth/")
