"""A made-up benchmark of three scenes, as one is downloaded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.registry import Option
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.native import NativeDataset, NativeOptions
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.protocol.model import ProtocolScene
from tests.own_protocols import photo_protocols
from tests.support import DOWN, NORTH_WEST, PLACE_CRS, PLACE_PHOTOS, run_main

SCENES = ("one", "two", "three")
NAMES = tuple(PLACE_PHOTOS)


@dataclass(frozen=True)
class FlightOptions(NativeOptions):
    """What differs between the tests."""

    parts: Annotated[str, Option("parts", "Which parts scenes have.")] = "dom dsm"
    published: Annotated[int, Option("published", "Queries of a scene.")] = 4
    track: Annotated[str, Option("track", "Which protocol there is.")] = "retrieval"


class Flights(NativeDataset[FlightOptions]):
    """Three flights; reading them is counted."""

    summary = "Make a benchmark of flights."
    example = "flights --source flights"
    options = FlightOptions
    about = About("Flights", "https://example.org", "CC BY 4.0", assumptions=("North is up.",))

    def __init__(self) -> None:
        self.read_scenes: list[str] = []
        self.stop_at: str | None = None

    def benchmark(self, options: FlightOptions) -> str:
        return "flights"

    def protocols(self, options: FlightOptions, root: Path) -> BenchmarkProtocols:
        made = photo_protocols("flights", (64,))
        scenes = tuple(
            ProtocolScene(id=one, title=f"Flight {one}", queries=options.published)
            for one in SCENES
        )
        every = {of.track: of.model_copy(update={"scenes": scenes}) for of in made.every}
        return BenchmarkProtocols(**{options.track: every[options.track]})  # type: ignore[arg-type]

    def scenes(self, options: FlightOptions) -> list[str]:
        return [one for one in SCENES if (options.source / one).is_dir()]

    def files(self, options: FlightOptions, scene: str) -> list[Path]:
        return [options.source / scene]

    def read(self, options: FlightOptions, scene: str, progress: Progress) -> NativeScene:
        from airzoo_bench.geometry.cameras import Cameras
        from airzoo_bench.geometry.poses import Poses

        self.read_scenes.append(scene)
        if scene == self.stop_at:
            raise KeyboardInterrupt
        home = options.source / scene
        if (home / "broken").is_file():
            raise BenchmarkError("half a download", where=home / "broken")
        matrices = np.array([[[64.0, 0, 32], [0, 64, 24], [0, 0, 1]]] * 4)
        cameras = Cameras.from_matrices(
            matrices, np.full(4, 64), np.full(4, 48), np.zeros((4, 5)), names=NAMES
        )
        x, y = np.array(list(PLACE_PHOTOS.values())).T
        centres = np.stack([NORTH_WEST[0] + x, NORTH_WEST[1] - y, np.full(4, 200.0)], axis=1)
        poses = Poses.from_centres(np.array([DOWN] * 4), centres, NAMES)
        parts = options.parts.split()
        return NativeScene(
            scene,
            home / "photos",
            NAMES,
            cameras,
            poses,
            LOCAL_CRS if "local" in parts else PLACE_CRS,
            dom=home / "dom.tif" if "dom" in parts else None,
            dsm=home / "dsm.tif" if "dsm" in parts else None,
            cloud=home / "cloud.npy" if "cloud" in parts else None,
            plane_height_m=100.0 if "plane" in parts else None,
            conditions={"weather": ("fog", "sun", "sun", "rain")},
            notes=("its heading is assumed",),
        )


def mark_photos(images: Path, mark: str, but: int = 0) -> str:
    """Change the photos' bytes, not their pixels; return the name of one that is left aside."""
    photos = sorted(path for path in images.rglob("*") if path.is_file())
    for photo in photos[but:]:
        with photo.open("ab") as stream:
            stream.write(f"{mark} {photo.name}".encode())
    return photos[0].relative_to(images).as_posix()


def prepare(source: Path, *more: object) -> int:
    return run_main("prepare", "flights", "--source", source, *more)


def everything(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}
