"""``airzoo-bench mini``: the world of AirZoo-Mini, and photos of it."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import JobsOption, LightGroup, examples, progress, put, say
from airzoo_bench.core.errors import counted
from airzoo_bench.engines.engine import Processes

__all__ = ["app"]


class _Region(StrEnum):
    CITY = "city"
    RURAL = "rural"


class _Flight(StrEnum):
    BARREL_ROLL = "barrel-roll"
    SURVEY = "survey"


app = typer.Typer(
    cls=LightGroup,
    help="AirZoo-Mini: make its world, and take photos of it.",
    no_args_is_help=True,
)

SeedOption = Annotated[int, typer.Option(min=0, help="Another seed is another place.")]


@app.callback()
def _group() -> None:
    """AirZoo-Mini: make its world, and take photos of it."""


@app.command(epilog=examples("mini world"))
def world(seed: SeedOption = 0, jobs: JobsOption = 2) -> None:
    """Make the world, and say where its maps lie (orthophoto, surface model, satellite mosaic)."""
    from airzoo_bench.core.files import data_root
    from airzoo_bench.datasets.mini.dataset import make_worlds
    from airzoo_bench.datasets.mini.world import REGIONS

    regions = list(REGIONS.values())
    folders = make_worlds(regions, data_root(), seed, Processes(jobs), progress)
    for region, folder in zip(regions, folders, strict=True):
        put(f"{region.name}\n")
        for name in ("dom", "dsm", "satellite"):
            put(f"  {folder / name}.tif\n")


@app.command(epilog=examples("mini render --region rural --weather foggy -o frames"))
def render(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write into.")],
    region: Annotated[_Region, typer.Option(help="Which of its regions.")] = _Region.CITY,
    flight: Annotated[_Flight, typer.Option(help="The kind of flight.")] = _Flight.BARREL_ROLL,
    overlap: Annotated[
        float, typer.Option(min=0.01, max=0.95, help="Overlap of neighbouring photos.")
    ] = 0.5,
    weather: Annotated[str, typer.Option(help="sunny, cloudy, rainy, foggy, snowy.")] = "sunny",
    time_of_day: Annotated[str, typer.Option(help="day, sunset, night.")] = "day",
    seed: SeedOption = 0,
    jobs: JobsOption = 2,
) -> None:
    """Render a flight's key frames: photos, metric depth, and where each was taken.

    A run that was stopped goes on: frames that are there are not rendered again.
    """
    from airzoo_bench.core.files import data_root
    from airzoo_bench.datasets.mini import flights
    from airzoo_bench.datasets.mini.dataset import make_worlds
    from airzoo_bench.datasets.mini.frames import FrameList, render_frames
    from airzoo_bench.datasets.mini.renderer import default_camera
    from airzoo_bench.datasets.mini.world import REGIONS, load_world

    (made,) = make_worlds([REGIONS[region]], data_root(), seed, progress=progress)
    camera = default_camera()
    airspace = flights.Airspace.over(REGIONS[region], load_world(made).dsm)
    orbits = flight is _Flight.BARREL_ROLL
    flown = flights.barrel_roll(airspace, seed) if orbits else flights.survey(airspace)
    keys = flights.key_frames(flown, camera, airspace.ground_m, overlap)
    frames = FrameList(
        names=tuple(f"{frame:06d}" for frame in keys),
        camera=camera,
        poses=flown.take(keys),
        weather=(weather,) * len(keys),
        time_of_day=(time_of_day,) * len(keys),
        seed=seed,
    )
    render_frames(frames, made, out, engine=Processes(jobs), progress=progress)
    say(f"{counted(len(keys), 'frame')} in {out}: frames.csv, images/, depth/, colmap/")
