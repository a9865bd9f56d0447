"""``airzoo-bench mini``: the world of AirZoo-Mini, and photos of it."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import LightGroup, examples, in_panels, progress, put, say
from airzoo_bench.core.errors import counted
from airzoo_bench.engines.engine import Processes

_OVERLAP = 0.5  # of neighbouring photos


class _Region(StrEnum):
    CITY = "city"
    RURAL = "rural"


class _Flight(StrEnum):
    BARREL_ROLL = "barrel-roll"
    SURVEY = "survey"


app = typer.Typer(
    cls=LightGroup, help="Render frames of AirZoo-Mini's world.", no_args_is_help=True
)
app.callback()(lambda: None)


@app.command(cls=in_panels({}), epilog=examples("mini render --region rural -o frames"))
def render(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write into.")],
    region: Annotated[_Region, typer.Option(help="The region.")] = _Region.CITY,
    flight: Annotated[_Flight, typer.Option(help="The kind of flight.")] = _Flight.BARREL_ROLL,
    weather: Annotated[str, typer.Option(help="sunny, cloudy, rainy, foggy, snowy.")] = "sunny",
    time_of_day: Annotated[str, typer.Option(help="day, sunset, night.")] = "day",
    seed: Annotated[int, typer.Option(min=0, help="Another seed makes another world.")] = 0,
) -> None:
    """Render a flight's key frames: photos, metric depth and poses.

    Prints the maps of the region: orthophoto, surface model, satellite mosaic. A run that was
    stopped goes on: frames that are there are not rendered again.
    """
    from airzoo_bench.core.files import data_root
    from airzoo_bench.datasets.mini import flights
    from airzoo_bench.datasets.mini.dataset import make_worlds
    from airzoo_bench.datasets.mini.frames import FrameList, render_frames
    from airzoo_bench.datasets.mini.renderer import default_camera
    from airzoo_bench.datasets.mini.world import REGIONS, load_world

    engine = Processes(2)
    (made,) = make_worlds([REGIONS[region]], data_root(), seed, engine, progress)
    put("".join(f"{made / name}.tif\n" for name in ("dom", "dsm", "satellite")))
    camera = default_camera()
    airspace = flights.Airspace.over(REGIONS[region], load_world(made).dsm)
    orbits = flight is _Flight.BARREL_ROLL
    flown = flights.barrel_roll(airspace, seed) if orbits else flights.survey(airspace)
    keys = flights.key_frames(flown, camera, airspace.ground_m, _OVERLAP)
    frames = FrameList(
        names=tuple(f"{frame:06d}" for frame in keys),
        camera=camera,
        poses=flown.take(keys),
        weather=(weather,) * len(keys),
        time_of_day=(time_of_day,) * len(keys),
        seed=seed,
    )
    render_frames(frames, made, out, engine=engine, progress=progress)
    say(f"{counted(len(keys), 'frame')} in {out}: frames.csv, images/, depth/, colmap/")
