"""GTA-UAV: drone images and satellite tiles of a game's map, paired by overlap."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, Field, TypeAdapter, ValidationError, model_validator

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.validation import validation_message
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.published.class_folders import DIRECTIONS
from airzoo_bench.datasets.published.places import find_home, missing
from airzoo_bench.datasets.scenes import ImageScene
from airzoo_bench.datasets.settings import SourceOptions
from airzoo_bench.retrieval.stated_truth import ImageSet, StatedPairs

__all__ = ["GTA_UAV"]

_AREAS = ("cross-area", "same-area")
_TILES = 14_640
_MOST_BYTES = 1 << 30
_MAP_PX, _TILE_PX, _GSD_M = 24_576, 256, 0.45
_TILE_NAME = re.compile(r"(\d{1,2})_(\d{1,3})_(\d{1,5})_(\d{1,5})\.png", re.IGNORECASE)
_NEAR_M = 0.01
_LAYOUT = f"{_AREAS[0]}-drone2sate-test.json and {_AREAS[1]}-..., drone/images/ and satellite/"

_Number = Annotated[float, Field(strict=True, ge=-1e9, le=1e9)]
_Place = tuple[_Number, _Number]
_Weight = Annotated[float, Field(ge=0, le=1)]


def _below(name: str) -> str:
    if ".." in name.replace("\\", "/").split("/"):
        raise ValueError("it leads out of the benchmark")
    return name


_Name = Annotated[str, Field(pattern=r"^[^\x00-\x1f]+$"), AfterValidator(_below)]


class _Entry(BaseModel):
    """A drone image with the tiles that answer it, and these with the semi-positive ones."""

    home: _Name = Field(alias="drone_img_dir")
    name: _Name = Field(alias="drone_img_name")
    place: _Place = Field(alias="drone_loc_x_y")
    tiles: _Name = Field(alias="sate_img_dir")
    positive: list[_Name] = Field(alias="pair_pos_sate_img_list")
    positive_weights: list[_Weight] = Field(alias="pair_pos_sate_weight_list")
    positive_places: list[_Place] = Field(alias="pair_pos_sate_loc_x_y_list")
    every: list[_Name] = Field(alias="pair_pos_semipos_sate_img_list")
    every_weights: list[_Weight] = Field(alias="pair_pos_semipos_sate_weight_list")
    every_places: list[_Place] = Field(alias="pair_pos_semipos_sate_loc_x_y_list")
    drone_metadata: dict[str, Any] | None = None

    @model_validator(mode="after")
    def _lists_fit(self) -> _Entry:
        for name in ("positive", "every"):
            lists = [getattr(self, name + end) for end in ("", "_weights", "_places")]
            if len({*map(len, lists)}) > 1:
                raise ValueError(f"lists of tiles, weights and places differ in length ({name})")
        return self

    @property
    def image(self) -> str:
        """The file, relative to the benchmark."""
        return f"{self.home}/{self.name}"

    @property
    def height_m(self) -> float:
        """Height of the drone, NaN where it is not stated."""
        height = (self.drone_metadata or {}).get("height")
        return round(float(height), 3) if isinstance(height, int | float) else math.nan

    @property
    def stated(self) -> list[tuple[str, _Place]]:
        """The tiles of both lists with their places."""
        both = zip(self.positive, self.positive_places, strict=True)
        return [*both, *zip(self.every, self.every_places, strict=True)]

    @property
    def weights(self) -> dict[str, float]:
        """The overlap of each tile; positive ones that are missing among all are added."""
        own = dict(zip(self.positive, self.positive_weights, strict=True))
        return own | dict(zip(self.every, self.every_weights, strict=True))


_ENTRIES = TypeAdapter(Annotated[list[_Entry], Field(min_length=1)])


class GtaUav(Dataset[SourceOptions]):
    """GTA-UAV; a scene is a test list in a direction."""

    name = "gta-uav"
    about = about_of("gta-uav")
    protocols = tuple(f"gta-uav-{area}-{direction}" for area in _AREAS for direction in DIRECTIONS)

    def scenes(self, options: SourceOptions) -> Mapping[str, Sequence[Path]]:
        """Return both areas in both directions."""
        home = _home(options)
        return {f"{area}-{direction}": [home] for area in _AREAS for direction in DIRECTIONS}

    def read(self, options: SourceOptions, scene: str, progress: Progress) -> ImageScene:
        """Read the test list of an area, and turn it round for the way back."""
        home = _home(options)
        area = next(area for area in _AREAS if scene.startswith(area))
        entries = _read_entries(home / f"{area}-drone2sate-test.json")
        backwards = scene.endswith(DIRECTIONS[1])
        drones = sorted((e for e in entries if e.positive), key=lambda e: e.name)
        if not drones:
            raise BenchmarkError("no entry of the list has a positive tile", where=home)
        folder = home / drones[0].tiles
        there = _tiles_below(folder)
        _check(home, folder, drones, there)
        answers = {tile for one in drones for tile in one.positive}
        names = sorted(answers if backwards else there)
        row = {name: number for number, name in enumerate(names)}
        centres = np.array([_tile_centre(name) for name in names])
        tiles = ImageSet([Path(n).stem for n in names], [there[n] for n in names], centres)
        heights = [one.height_m for one in drones]
        images = ImageSet(
            [Path(one.name).stem for one in drones],
            [one.image for one in drones],
            np.array([one.place for one in drones]),
            conditions={} if backwards or np.isnan(heights).any() else {"height_m": heights},
        )
        pairs = [
            (number, row[tile], tile in one.positive, weight)
            for number, one in enumerate(drones)
            for tile, weight in one.weights.items()
            if tile in row
        ]
        drone, tile, positive, weight = (np.array(column) for column in zip(*pairs, strict=True))
        if backwards:
            stated = StatedPairs(tile, drone, positive, weight)
            return ImageScene(scene, tiles, images, folder, home, stated)
        stated = StatedPairs(drone, tile, positive, weight)
        return ImageScene(scene, images, tiles, home, folder, stated, _TILES)


def _home(options: SourceOptions) -> Path:
    names = [f"{area}-drone2sate-test.json" for area in _AREAS]
    return find_home(
        options.source, lambda folder: any((folder / name).is_file() for name in names), _LAYOUT
    )


def _read_entries(path: Path) -> list[_Entry]:
    """Read a list of drone images."""
    text = read_text(path, BenchmarkError, "list of pairs", _MOST_BYTES)
    try:
        return _ENTRIES.validate_json(text.removeprefix("\ufeff"))
    except ValidationError as error:
        raise BenchmarkError(
            validation_message(error, _Entry),
            where=path,
            expected="a list, an entry a drone image",
            fix="download it again: it may be cut short",
        ) from error


def _tile_centre(name: str) -> tuple[float, float]:
    """Return where the centre of a tile is, in metres, by its name ``zoom_offset_x_y.png``."""
    zoom, offset, x, y = map(int, Path(name).stem.split("_"))
    side = _MAP_PX / 2**zoom
    east, south = (side * (index + 1 / 2 + offset / _TILE_PX) * _GSD_M for index in (x, y))
    return east, south


def _tiles_below(folder: Path) -> dict[str, str]:
    """Return the files of the tiles, relative to their folder, by name."""
    files = [path for path in folder.rglob("*.png") if path.is_file()]
    odd = [path.name for path in files if not _TILE_NAME.fullmatch(path.name)]
    if odd or not files:
        what = (
            f"names that are none of a tile ({first_of(sorted(odd))})" if odd else "holds no tile"
        )
        raise missing(what, folder, "zoom_offset_x_y.png, such as 4_0_6_13.png")
    return {path.name: path.relative_to(folder).as_posix() for path in files}


def _check(home: Path, folder: Path, drones: Sequence[_Entry], there: Mapping[str, str]) -> None:
    """Refuse files that are missing, and a list of another map."""
    lacking = sorted({tile for one in drones for tile, _ in one.stated} - set(there))
    lacking += [one.image for one in drones if not (home / one.image).is_file()]
    if lacking:
        raise missing(f"files of the list are missing ({first_of(lacking)})", home, _LAYOUT)
    for one in drones:
        for tile, place in one.stated:
            if math.dist(place, _tile_centre(tile)) > _NEAR_M:
                raise BenchmarkError(
                    f"tile {tile} is at {place} by the list of {one.name}",
                    where=folder,
                    expected=f"the centre {_tile_centre(tile)} that its name says",
                    fix="this list is of another map: download the lists again",
                )


GTA_UAV = GtaUav()
