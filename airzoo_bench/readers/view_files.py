"""Maps of views under the names that a method gives them, read as those of the suite are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.core.ids import IMAGE_SUFFIXES
from airzoo_bench.readers.scene_folders import ScenePlaces

if TYPE_CHECKING:
    from airzoo_bench.formats.budget import Budget
    from airzoo_bench.formats.npz import NpzFile
    from airzoo_bench.reconstruction.predictions import ScenePrediction

__all__ = [
    "GivenArrays",
    "ViewFields",
    "ViewNames",
    "as_maps",
    "check_count",
    "in_photo_order",
    "inverted",
    "read_views",
    "sorted_images",
    "view_names",
]


@dataclass(frozen=True)
class ViewNames:
    """Names of a scene's views, in their order.

    Attributes
    ----------
    names : sequence of str
        As the benchmark names the photos.
    source : str
        Where they come from.
    """

    names: Sequence[str]
    source: str


def sorted_images(folder: Path) -> list[str]:
    """Return the names of the images in a folder, sorted; none where there is no such folder."""
    if not folder.is_dir():
        return []
    files = (one for one in folder.iterdir() if not one.name.startswith("."))
    return sorted(one.name for one in files if one.name.lower().endswith(IMAGE_SUFFIXES))


def view_names(scenes: ScenePlaces, place: Path, beside: Path | None = None) -> ViewNames | None:
    """Name the views of a scene: by ``--names``, else by the sorted images beside them."""
    listed = scenes.listed_names(place)
    if listed is not None:
        return ViewNames(scenes.photos(place, listed), f"in {scenes.reading.names}")
    found = [] if beside is None else sorted_images(beside)
    return ViewNames(scenes.photos(place, found), f"of images in {beside}") if found else None


def in_photo_order(scenes: ScenePlaces, beside: Path | None = None) -> str:
    """Say how views are named, for a reader's conventions."""
    if scenes.reading.names is not None:
        return f"views named by {scenes.reading.names.name}, in its order"
    if beside is not None and sorted_images(beside):
        return f"views named by the images in {beside.name}/, sorted by name"
    return "views taken for the scene's photos in the order of their names, which poses must fit"


@dataclass(eq=False)
class GivenArrays:
    """Arrays by the suite's names, each made of a method's own; as `formats.arrays.Arrays`."""

    path: Path
    budget: Budget
    fields: Mapping[str, Callable[[], Any]]

    def names(self) -> set[str]:
        """Return the names of the fields."""
        return set(self.fields)

    def read(self, name: str) -> Any:
        """Return a field."""
        return self.fields[name]()

    map = read


@dataclass(frozen=True)
class ViewFields:
    """What a method calls its fields.

    Attributes
    ----------
    intrinsics, extrinsics : str
    confidence : mapping of str to str
        The field of confidence, by that of the maps.
    maps : tuple of str
        Depth, and points where there is no depth.
    mask : str or None
        False where the method takes its own value for none.
    camera_to_world : bool
        Whether extrinsics are that.
    """

    intrinsics: str
    extrinsics: str
    confidence: Mapping[str, str]
    maps: tuple[str, ...] = ("depth", "world_points")
    mask: str | None = None
    camera_to_world: bool = False


def read_views(
    file: NpzFile,
    fields: ViewFields,
    names: ViewNames | None,
    made: Mapping[str, Callable[[], Any]] | None = None,
) -> ScenePrediction:
    """Read depth maps, or point maps where there are none; pixel centres are integers."""
    import numpy as np

    from airzoo_bench.reconstruction.predictions import maps_of

    there = file.names()
    chosen = next((name for name in fields.maps if name in there), None)
    if chosen is None:
        raise PredictionError(
            f"holds neither {' nor '.join(fields.maps)}",
            where=file.path,
            expected="the maps that the method wrote",
        )
    maps = _masked(file, chosen, fields.mask)
    given: dict[str, Callable[[], Any]] = {
        chosen: lambda: maps,
        "pixel_centres": lambda: np.array("integer"),
    }
    confidence = fields.confidence.get(chosen)
    if confidence in there:
        given["conf"] = lambda: as_maps(file, str(confidence), 3)
    if fields.intrinsics in there:
        given["intrinsics"] = lambda: _without_batch(file.read(fields.intrinsics))
    if fields.extrinsics in there:
        turn = inverted if fields.camera_to_world else np.asarray
        given["extrinsics"] = lambda: turn(_without_batch(file.read(fields.extrinsics)))
    given |= made or {}
    check_count(file.path, names, len(maps))
    if names is not None:
        given["image_names"] = lambda: np.array(names.names, dtype=str)
    return maps_of(GivenArrays(file.path, file.budget, given))


def as_maps(file: NpzFile, name: str, ndim: int) -> Any:
    """Return maps (N, H, W) or (N, H, W, 3), without an axis of 1 before or behind."""
    entry = file.entries[name]
    shape = _stripped(entry.shape, ndim)
    if len(shape) != ndim:
        raise PredictionError(
            f"field '{name}' has shape {entry.shape}",
            where=file.path,
            expected=f"shape ({', '.join('NHW'[:ndim])}{', 3' * (ndim - 3)})",
            fix="save what the method returns as it is",
        )
    return file.map(name).reshape(shape)


def _stripped(shape: tuple[int, ...], ndim: int) -> tuple[int, ...]:
    if len(shape) > ndim and shape[-1] == 1:
        shape = shape[:-1]
    if len(shape) > ndim and shape[0] == 1:
        shape = shape[1:]
    return shape


def _without_batch(values: Any) -> Any:
    return values[0] if values.ndim == 4 and len(values) == 1 else values


def _masked(file: NpzFile, name: str, mask_name: str | None) -> Any:
    """Return maps that have no surface where the mask is False."""
    import numpy as np

    from airzoo_bench.reconstruction.fusion import LazyMaps

    points = name != "depth"
    values = as_maps(file, name, 3 + points)
    if mask_name is None or mask_name not in file.names() or values.dtype.kind != "f":
        return values
    mask = as_maps(file, mask_name, 3)
    if mask.dtype.kind != "b" or mask.shape != values.shape[:3]:
        raise PredictionError(
            f"field '{mask_name}' is {mask.dtype} of shape {mask.shape}",
            where=file.path,
            expected=f"bool of shape {values.shape[:3]}, that of '{name}'",
        )

    def seen(row: int) -> Any:
        kept = mask[row].view(np.uint8) != 0
        return np.where(kept[..., None] if points else kept, values[row], np.nan)

    return LazyMaps(np.arange(len(values)), values.shape[1:], values.dtype, seen)


def inverted(matrices: Any) -> Any:
    """Turn camera-to-world matrices (N, 3 or 4, 4) into world-to-camera; others stay as they are.

    Rotations are transposed; what is none is none then either, and is refused where poses are read.
    """
    import numpy as np

    if matrices.ndim != 3 or matrices.shape[1:] not in ((3, 4), (4, 4)):
        return matrices
    inverse = matrices.astype(np.float64) if matrices.dtype.kind == "f" else matrices.copy()
    rotation = np.swapaxes(inverse[:, :3, :3], 1, 2).copy()
    with np.errstate(all="ignore"):  # of NaN and of what is refused below
        inverse[:, :3, 3] = -(rotation @ inverse[:, :3, 3:])[..., 0]
    inverse[:, :3, :3] = rotation
    return inverse


def check_count(path: Path, names: ViewNames | None, count: int) -> None:
    """Refuse names of another number than the views."""
    if names is not None and len(names.names) != count:
        raise PredictionError(
            f"holds {counted(count, 'view')}, and there are {len(names.names):,} names "
            f"{names.source}",
            where=path,
            expected="the name of each view",
            fix="list the photos in the order in which the method was given them, a line each, "
            "and give the list with --names",
        )
