"""Arrays a scene: maps of views and their cameras in one npz, under a method's own names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import npz_fields
from airzoo_bench.formats.arrays import check_fields, texts
from airzoo_bench.formats.npz import Budget, NpzFile
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.readers.scenes import Layout, SceneOutput, ViewNames
from airzoo_bench.reconstruction.fusion import LazyMaps
from airzoo_bench.reconstruction.predictions import ScenePrediction, maps_of

CENTRES_AND_SIZE = (
    "pixel centres are integers: the principal point is shifted by half a pixel",
    "intrinsics of the images as the network sees them",
)


@dataclass(eq=False)
class MadeArrays:
    """Arrays by the suite's names, made of a method's own; as `formats.arrays.Arrays`."""

    path: Path
    budget: Budget
    fields: Mapping[str, Any]

    def names(self) -> set[str]:
        """Return the names of the fields."""
        return set(self.fields)

    def read(self, name: str) -> Any:
        """Return a field."""
        return self.fields[name]

    map = read


def scene_of(
    path: Path, budget: Budget, fields: Mapping[str, Any], names: ViewNames | None
) -> ScenePrediction:
    """Read fields by the suite's names, with pixel centres at integers, under names of views."""
    fields = {**fields, "pixel_centres": np.array("integer")}
    if names is not None:
        names.check(path, len(fields["depth" if "depth" in fields else "world_points"]))
        fields["image_names"] = np.array(names.names, dtype=str)
    return maps_of(MadeArrays(path, budget, fields))


def inverted(matrices: Any) -> Any:
    """Turn camera-to-world matrices (N, 3 or 4, 4) into world-to-camera; others stay as they are.

    Rotations are transposed; what is none is none then either, and is refused where poses are read.
    """
    if matrices.ndim != 3 or matrices.shape[1:] not in ((3, 4), (4, 4)):
        return matrices
    inverse = matrices.astype(np.float64) if matrices.dtype.kind == "f" else matrices.copy()
    rotation = np.swapaxes(inverse[:, :3, :3], 1, 2).copy()
    with np.errstate(all="ignore"):  # of NaN and of what is refused later
        inverse[:, :3, 3] = -(rotation @ inverse[:, :3, 3:])[..., 0]
    inverse[:, :3, :3] = rotation
    return inverse


def as_maps(file: NpzFile, name: str, ndim: int) -> Any:
    """Return maps (N, H, W) or (N, H, W, 3), without an axis of 1 before or behind."""
    given = shape = file.entries[name].shape
    if len(shape) > ndim and shape[-1] == 1:
        shape = shape[:-1]
    if len(shape) > ndim and shape[0] == 1:
        shape = shape[1:]
    if len(shape) != ndim:
        raise PredictionError(
            f"field '{name}' has shape {given}",
            where=file.path,
            expected=f"shape ({', '.join('NHW'[:ndim])}{', 3' * (ndim - 3)})",
            fix="save what the method returns as it is",
        )
    return file.map(name).reshape(shape)


@dataclass(frozen=True)
class ViewArrays(Layout):
    """An npz a scene: depth maps, or point maps where there is no depth, with their cameras."""

    maps: Mapping[str, str]  # "depth" or "world_points" by the method's name; the first is read
    confidence: Mapping[str, str]  # its field by the method's name of the maps
    needed: tuple[set[str], ...]  # of each set one field is there in files of this layout
    extrinsics: str  # world-to-camera, unless `camera_to_world`
    intrinsics: str  # need not be there
    files: tuple[str, ...] = ("predictions.npz",)  # where in a scene's folder: patterns of one file
    mask: str | None = None  # False where the method takes its own value for none
    names: str | None = None  # a field with the names of the photos
    never: frozenset[str] = frozenset()  # fields of other layouts
    only: frozenset[str] | None = None  # all fields: others make a file none, or are refused
    strict: bool = False  # if they are refused
    camera_to_world: bool = False
    cameras: Callable[[NpzFile, tuple[int, ...]], tuple[Floats, Floats]] | None = None
    photos: str | None = "images"  # a folder beside the file, by whose names views are sorted
    said: tuple[str, ...] = ()  # conventions

    def sure(self, place: Path) -> float:
        """See `Layout.sure`."""
        return 0.9 * (self.find(place) is not None)

    def find(self, place: Path) -> Path | None:
        """Return the file of a scene: the place itself, or the first that lies in its folder."""
        if not place.is_dir():
            return place if self._fits(place) else None
        for pattern in self.files:
            fitting = [one for one in place.glob(pattern) if self._fits(one)]
            if len(fitting) == 1:
                return fitting[0]
        return None

    def _fits(self, path: Path) -> bool:
        names = npz_fields(path)
        return (
            all(names & some for some in self.needed)
            and not names & self.never
            and (self.only is None or self.strict or names <= self.only)
        )

    @cached_property
    def _fields(self) -> frozenset[str]:
        named = {self.extrinsics, self.intrinsics, self.mask or "", self.names or ""}
        return frozenset(named.union(self.maps, self.confidence.values(), *self.needed))

    def views(self, output: SceneOutput) -> ViewNames | None:
        """See `Layout.views`."""
        path = self.find(output.place) or output.place
        names = output.view_names(None if self.photos is None else path.parent / self.photos)
        if names is not None or self.names not in npz_fields(path):
            return names
        file = NpzFile(path, output.reading.memory_bytes, npz_fields(path) - {str(self.names)})
        listed, where = texts(file, str(self.names), 1).tolist(), f"the field {self.names}"
        return ViewNames(output.photos(listed), f"in {where}", f"named by {where}")

    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        """See `Layout.read`."""
        path = self.find(output.place) or output.place
        file = NpzFile(path, memory, npz_fields(path) - (self.only or self._fields))
        if self.only is not None and self.strict:
            check_fields(NpzFile(path, memory), (), self.only, ", ".join(sorted(self.only)))
        own = next(name for name in self.maps if name in file.names())
        kind = self.maps[own]
        maps = self._masked(file, own, as_maps(file, own, 3 + (kind != "depth")))
        fields = {kind: maps} | self._cameras(file, maps.shape)
        if self.confidence[own] in file.names():
            fields["conf"] = as_maps(file, self.confidence[own], 3)
        return scene_of(path, file.budget, fields, self.views(output))

    def _cameras(self, file: NpzFile, shape: tuple[int, ...]) -> dict[str, Any]:
        """Return intrinsics and extrinsics, as far as the file has them; `cameras` makes both."""
        if self.cameras is not None and not {self.extrinsics, self.intrinsics} <= file.names():
            return dict(zip(("intrinsics", "extrinsics"), self.cameras(file, shape), strict=True))
        found = {}
        for name, own in (("intrinsics", self.intrinsics), ("extrinsics", self.extrinsics)):
            if own in file.names():
                values = file.read(own)
                found[name] = values[0] if values.ndim == 4 and len(values) == 1 else values
        if self.camera_to_world and "extrinsics" in found:
            found["extrinsics"] = inverted(found["extrinsics"])
        return found

    def _masked(self, file: NpzFile, name: str, values: Any) -> Any:
        """Return maps that have no surface where the mask is False."""
        if self.mask is None or self.mask not in file.names() or values.dtype.kind != "f":
            return values
        mask = as_maps(file, self.mask, 3)
        if mask.dtype.kind != "b" or mask.shape != values.shape[:3]:
            raise PredictionError(
                f"field '{self.mask}' is {mask.dtype} of shape {mask.shape}",
                where=file.path,
                expected=f"bool of shape {values.shape[:3]}, that of '{name}'",
            )

        def seen(row: int) -> Any:
            kept = mask[row].view(np.uint8) != 0
            return np.where(kept if values.ndim == 3 else kept[..., None], values[row], np.nan)

        return LazyMaps(np.arange(len(values)), values.shape[1:], values.dtype, seen)
