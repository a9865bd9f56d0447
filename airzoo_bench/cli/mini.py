"""``airzoo-bench mini``: a world made on the spot, flights over it, and own photos of it."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import JobsOption, LightGroup, examples, in_panels, progress, put, say
from airzoo_bench.cli.engines import EngineOption, ProgressOption, SchedulerOption, reported
from airzoo_bench.core.plurals import agreeing, counted
from airzoo_bench.engines.choose import EngineKind, chosen_engine

if TYPE_CHECKING:
    from airzoo_bench.datasets.mini.world.model import World

__all__ = ["app"]

app = typer.Typer(
    cls=LightGroup,
    help="AirZoo-Mini: make its world, plan flights, and render photos of your own flight.",
    no_args_is_help=True,
)

SeedOption = Annotated[int, typer.Option(min=0, help="Another seed is another place.")]


class RegionName(StrEnum):
    """Parts of the world."""

    CITY = "city"
    RURAL = "rural"


class Flight(StrEnum):
    """Flights that are planned here."""

    BARREL_ROLL = "barrel-roll"
    SURVEY = "survey"


RegionOption = Annotated[RegionName, typer.Option(help="Part of the world.")]


@app.callback()
def _group() -> None:
    """AirZoo-Mini: make its world, plan flights, and render photos of your own flight."""


@app.command(epilog=examples("mini world"))
def world(seed: SeedOption = 0, jobs: JobsOption = 2) -> None:
    """Make the world, and say where its maps lie (orthophoto, surface model, satellite mosaic)."""
    from airzoo_bench.core.places import data_root
    from airzoo_bench.datasets.mini.flights.trajectory import allowed_box
    from airzoo_bench.datasets.mini.prepare import make_worlds
    from airzoo_bench.datasets.mini.world.model import REGIONS
    from airzoo_bench.engines.processes import Processes

    regions = list(REGIONS.values())
    folders = make_worlds(
        regions, data_root(), seed, engine=Processes(jobs), progress=progress, note=say
    )
    for region, folder in zip(regions, folders, strict=True):
        west, south, east, north = allowed_box(region)
        put(f"{region.name}: longitude {west} to {east}, latitude {south} to {north}\n")
        for name in ("dom", "dsm", "satellite"):
            put(f"  {folder / name}.tif\n")


@app.command(epilog=examples("mini trajectory --region city --out my.csv"))
def trajectory(
    out: Annotated[Path, typer.Option("--out", "-o", help="The .csv or .json to write.")],
    region: RegionOption = RegionName.CITY,
    flight: Annotated[Flight, typer.Option(help="Which pattern is flown.")] = Flight.BARREL_ROLL,
    overlap: Annotated[
        float | None,
        typer.Option(
            min=0.01, max=0.99, help="Thin to key frames with this overlap (default: 30 fps)."
        ),
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="Draw the flight into this .png.")] = None,
    seed: SeedOption = 0,
) -> None:
    """Plan a flight and write it as a file, to be changed at will and rendered."""
    from airzoo_bench.datasets.mini.export.pictures import draw_flight
    from airzoo_bench.datasets.mini.flights.keyframes import key_frames
    from airzoo_bench.datasets.mini.flights.patterns import barrel_roll, survey
    from airzoo_bench.datasets.mini.flights.trajectory import Airspace
    from airzoo_bench.datasets.mini.flights.trajectory_files import write_trajectory
    from airzoo_bench.datasets.mini.rendering.renderer import default_camera

    made = _world(_folder(region, seed))
    airspace = Airspace.over(made.region, made.dsm)
    flown = barrel_roll(airspace, seed) if flight is Flight.BARREL_ROLL else survey(airspace)
    if overlap is not None:
        flown = flown.take(key_frames(flown, default_camera(), airspace.ground_m, overlap))
    write_trajectory(out, flown)
    say(f"wrote {counted(len(flown), 'frame')} to {out}")
    if picture is not None:
        draw_flight(flown, made.region, picture, f"{flight}, {region}")
        say(f"wrote {picture}")
    say(f"next: airzoo-bench mini render --trajectory {out} --region {region} --out frames")


_RENDER_PANELS = {
    "What is rendered": ("trajectory", "region", "weather", "time_of_day", "seed"),
    "Photos": ("out", "width", "height", "field"),
    "Resources": ("jobs", "engine", "scheduler", "show_progress"),
}


@app.command(
    cls=in_panels(_RENDER_PANELS),
    epilog=examples("mini render --trajectory my.csv --region city -o frames"),
)
def render(
    trajectory: Annotated[Path, typer.Option(help="A .csv or .json; see `mini trajectory`.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write into.")],
    region: RegionOption = RegionName.CITY,
    weather: Annotated[
        str, typer.Option(help="Where the file does not say: sunny, cloudy, rainy, foggy, snowy.")
    ] = "sunny",
    time_of_day: Annotated[
        str, typer.Option(help="Where the file does not say: day, sunset, night.")
    ] = "day",
    width: Annotated[int, typer.Option(min=16, help="Of the photos, px.")] = 640,
    height: Annotated[int, typer.Option(min=16, help="Of the photos, px.")] = 480,
    field: Annotated[
        float, typer.Option(min=5.0, max=150.0, help="Horizontal field of view, degrees.")
    ] = 62.0,
    seed: SeedOption = 0,
    jobs: JobsOption = 2,
    engine: EngineOption = EngineKind.LOCAL,
    scheduler: SchedulerOption = None,
    show_progress: ProgressOption = False,
) -> None:
    """Render a flight: photos, metric depth, and where each was taken.

    A run that was stopped goes on: frames that are there are not rendered again.
    """
    from functools import partial

    from airzoo_bench.datasets.mini.export.frame_list import FrameList
    from airzoo_bench.datasets.mini.export.frames import render_frames
    from airzoo_bench.datasets.mini.flights.trajectory import check_inside, trajectory_poses
    from airzoo_bench.datasets.mini.flights.trajectory_files import read_trajectory
    from airzoo_bench.datasets.mini.rendering.renderer import default_camera
    from airzoo_bench.datasets.mini.world.store import load_world
    from airzoo_bench.engines.processes import Processes

    flown = read_trajectory(trajectory)
    frames = FrameList(
        names=flown.names,
        camera=default_camera(width, height, field),
        poses=trajectory_poses(flown),
        weather=flown.weather or (weather,) * len(flown),
        time_of_day=flown.time_of_day or (time_of_day,) * len(flown),
        seed=seed,
    )
    folder = _folder(region, seed)
    made = _world(folder)
    check_inside(flown, made.region, made.dsm, trajectory)
    load = partial(load_world, folder)
    with (
        chosen_engine(engine, scheduler, jobs=jobs, here=Processes(jobs), note=say) as place,
        reported(place, show_progress=show_progress) as (used, shown),
    ):
        counts = render_frames(frames, load, out, engine=used, progress=shown)
    were = agreeing(counts.kept, "was", "were")
    kept = f", {counts.kept} {were} there already" if counts.kept else ""
    say(f"rendered {counted(counts.rendered, 'frame')} into {out}{kept}")
    put(f"{out / 'frames.csv'}\n{out / 'images'}\n{out / 'depth'}\n{out / 'colmap'}\n")


@app.command(epilog=examples("mini pictures --out pictures"))
def pictures(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to draw into.")],
    seed: SeedOption = 0,
) -> None:
    """Draw the maps of both regions, a place in every weather and light, and the flights."""
    from airzoo_bench.datasets.mini.export.pictures import draw_world

    for region in RegionName:
        for path in draw_world(_world(_folder(region, seed)), out, progress):
            put(f"{path}\n")


def _folder(region: RegionName, seed: int) -> Path:
    from airzoo_bench.core.places import data_root
    from airzoo_bench.datasets.mini.prepare import make_worlds
    from airzoo_bench.datasets.mini.world.model import REGIONS

    regions = [REGIONS[region]]
    return make_worlds(regions, data_root(), seed, progress=progress, note=say)[0]


def _world(folder: Path) -> World:
    from airzoo_bench.datasets.mini.world.store import load_world

    return load_world(folder)
