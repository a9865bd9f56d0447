"""Readers of reconstructions: outputs of scenes, photos of their views, maps in an npz.

A path is one scene's output, where the protocol has one scene or the path is named by its scene;
or a folder with such an output a scene, ``PATH/<scene>/...``. A reader has layouts of outputs.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.files import npz_fields
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.predictions import PredictionFile, Reader, ReadRequest
from airzoo_bench.evaluation.track import ScenePredictions
from airzoo_bench.formats.arrays import gather, texts
from airzoo_bench.formats.npz import Budget, NpzFile
from airzoo_bench.formats.photos import PHOTO_SUFFIXES
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.readers.names import ImageNames, names_in, read_names
from airzoo_bench.reconstruction.predictions import ScenePrediction, read_maps
from airzoo_bench.reconstruction.truth import ReconstructionTruth

_LOOKED_AT = 256
_OTHERS = ".webp .bmp .gif .heic .heif .avif .jp2 .dng .ppm .pgm .exr"
_IMAGES = (*PHOTO_SUFFIXES, *_OTHERS.split())
_BY_NAME = "the scene's photos in the order of their names, which poses must fit"
_IN_ORDER = "list the photos in the order in which the method was given them, a line each"
CENTRES_AND_SIZE = (
    "pixel centres are integers: the principal point is shifted by half a pixel",
    "intrinsics of the images as the network sees them",
)


# --- outputs of scenes, and the photos of their views ---


@dataclass(frozen=True)
class SceneOutput:
    """One scene's output: a file or a folder, `alone` where the path has no other."""

    place: Path
    scene: str
    request: ReadRequest
    alone: bool = True

    def view_names(self, beside: Path | None = None) -> ViewNames | None:
        """Name the views by ``--names``, else by the sorted images in a folder next to them."""
        listed = self.request.names
        if listed is not None:
            names = self.photos(self.names_of_scene(read_names(listed)))
            return ViewNames(names, f"named by {listed.name}, in its order")
        names = [] if beside is None else [one.name for one in _children(beside)]
        found = [name for name in names if name.lower().endswith(_IMAGES)]
        if beside is None or not found:
            return None
        said = f"named by the images in {beside.name}/, sorted by name"
        return ViewNames(self.photos(found), said)

    def photos(self, names: Sequence[str]) -> list[str]:
        """Return the benchmark's names of the photos that names mean; others stay as they are."""
        truths = [one for one in self.request.truths if one.scene == self.scene]
        if not truths:
            return list(names)
        images = dict(names_in([truths[0].photos]))
        found = _photo_names(truths, self.request).find_all(names, self.place)
        return [images.get(str(one), name) for name, one in zip(names, found, strict=True)]

    def names_of_scene(self, names: list[str]) -> list[str]:
        """Return the listed names of this scene."""
        if self.alone:
            return names
        where = self.request.names or self.place
        found = _photo_names(self.request.truths, self.request).find_all(names, where)
        lost = [repr(name) for name, one in zip(names, found, strict=True) if one is None]
        if lost:
            what = f"names that are of no photo, so that their scene is not known: {first_of(lost)}"
            expected = "the photos of all scenes, such as school/DJI_0001.JPG, a line each"
            raise PredictionError(what, where=where, expected=expected, fix=_IN_ORDER)
        scenes = (str(one).split("/", 1)[0] for one in found)
        return [name for name, scene in zip(names, scenes, strict=True) if scene == self.scene]


def _photo_names(truths: Sequence[ReconstructionTruth], request: ReadRequest) -> ImageNames:
    photos = names_in(truth.photos for truth in truths)
    left_out = names_in(truth.excluded for truth in truths)
    return ImageNames("photo", photos, left_out=left_out, scenes=request.scenes)


class ViewNames(NamedTuple):
    """Photos of a scene's views in their order, as the benchmark names them, and where from."""

    names: list[str]
    said: str = ""

    def check(self, path: Path, count: int) -> None:
        """Refuse names of another number than the views."""
        if len(self.names) != count:
            what = f"holds {counted(count, 'view')}, and there are {len(self.names):,} names, "
            what += self.said
            fix = f"{_IN_ORDER}, and give the list with --names"
            raise PredictionError(what, where=path, expected="the name of each view", fix=fix)


class Layout(ABC):
    """A layout of a scene's output; `said` are conventions, see `PredictionFile`."""

    said: tuple[str, ...] = ()

    @abstractmethod
    def sure(self, place: Path) -> float:
        """Say how sure it is that a file or folder is one scene's output, 0 to 1."""

    def views(self, output: SceneOutput) -> ViewNames | None:
        """Name the views; None if they are the scene's photos in the order of their names."""
        return output.view_names()

    def order(self, output: SceneOutput) -> str:
        """Say which photo each view shows, for a reader's conventions."""
        names = self.views(output)
        return f"views are {names.said if names else _BY_NAME}"

    @abstractmethod
    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        """Read the output of one scene."""


class SceneReader(Reader):
    """Reads what a method writes of a scene: the output of one scene, or a folder of them."""

    track = "reconstruction"

    def __init__(self, title: str, layout: str, methods: tuple[str, ...], *layouts: Layout) -> None:
        self.title, self.layout, self.methods, self.layouts = title, layout, methods, layouts
        self.conventions = tuple(dict.fromkeys(one for some in layouts for one in some.said))

    def sure(self, place: Path) -> float:
        """Say how sure it is that a file or folder is one scene's output."""
        return max(layout.sure(place) for layout in self.layouts)

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        try:
            found = self.sure(path)
            some = _children(path)[:_LOOKED_AT] if not found else []
            return max(map(self.sure, some), default=found)
        except OSError:  # a folder that may not be listed is nobody's
            return 0.0

    def layout_of(self, place: Path) -> Any:
        """Return the layout that a place has."""
        return next((layout for layout in self.layouts if layout.sure(place)), None)

    def read(self, path: Path, request: ReadRequest) -> PredictionFile:
        """List the scenes; each is read when it is scored."""
        outputs, others = find_outputs(path, request, lambda one: self.layout_of(one) is not None)

        def open_scene(output: SceneOutput, memory: int, _: object) -> Any:
            with READERS.blaming(str(request.reader), f", reading {output.place}"):
                return nullcontext(self.layout_of(output.place).read(output, memory))

        entries = {output.scene: partial(open_scene, output) for output in outputs.values()}
        output = next(iter(outputs.values()))
        first = self.layout_of(output.place)
        said = (*first.said, first.order(output))
        return PredictionFile(ScenePredictions(path, entries, others), said)


def find_outputs(
    path: Path, request: ReadRequest, is_output: Callable[[Path], bool]
) -> tuple[dict[Path, SceneOutput], tuple[str, ...]]:
    """Find each scene's output by its place, and what is none; refuse none, and two of a scene."""
    known = [scene.id for scene in request.protocol.scenes]
    if is_output(path):
        return {path: SceneOutput(path, _only_scene(path, known), request)}, ()
    children = _children(path)
    found = {child: _scene_name(child) for child in children if is_output(child)}
    scenes = [*found.values()]
    twice = [one.name for one, scene in found.items() if scenes.count(scene) > 1]
    if not found or twice:
        what = "holds no scene's output that this reader reads"
        what = f"has two outputs of one scene: {' and '.join(twice)}" if twice else what
        expected = f"a folder a scene, such as {path.name}/{known[0]}/, as the method wrote it"
        fix = "`airzoo-bench readers` says what each reader recognises"
        raise PredictionError(what, where=path, expected=expected, fix=fix)
    alone = len(found) == 1
    outputs = {one: SceneOutput(one, scene, request, alone) for one, scene in found.items()}
    return outputs, tuple(child.name for child in children if child not in outputs)


def _only_scene(path: Path, known: list[str]) -> str:
    for name in (_scene_name(path), path.resolve().parent.name if path.is_file() else ""):
        if name in known:
            return name
    if len(known) == 1:
        return known[0]
    raise PredictionError(
        f"is the output of one scene, and the protocol has {len(known)}",
        where=path,
        expected=f"a folder with an output a scene: {first_of(known)}",
        fix=f"put it into a folder named by its scene, such as preds/{known[0]}/, and score preds",
    )


def _scene_name(place: Path) -> str:
    return place.name if place.is_dir() else place.stem


def _children(path: Path) -> list[Path]:
    found = path.iterdir() if path.is_dir() else ()
    return sorted(one for one in found if not one.name.startswith("."))


# --- maps of views and their cameras in an npz ---


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
    return read_maps(MadeArrays(path, budget, fields))


def invert_poses(matrices: Any) -> Any:
    """Turn camera-to-world matrices (N, 3 or 4, 4) into world-to-camera.

    Rotations are transposed; what is none, or of another shape, is refused where poses are read.
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
        expected = f"shape ({', '.join('NHW'[:ndim])}{', 3' * (ndim - 3)}), as the method makes it"
        what = f"field '{name}' has shape {given}"
        raise PredictionError(what, where=file.path, expected=expected)
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
    only: frozenset[str] | None = None  # all fields: a file with others is none
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
        fits = all(names & some for some in self.needed) and not names & self.never
        return fits and (self.only is None or names <= self.only)

    def views(self, output: SceneOutput) -> ViewNames | None:
        """See `Layout.views`."""
        path = self.find(output.place) or output.place
        names = output.view_names(None if self.photos is None else path.parent / self.photos)
        if names is not None or self.names not in npz_fields(path):
            return names
        file = NpzFile(path, output.request.memory_bytes, npz_fields(path) - {str(self.names)})
        listed = texts(file, str(self.names), 1).tolist()
        return ViewNames(output.photos(listed), f"named by the field {self.names}")

    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        """See `Layout.read`."""
        path = self.find(output.place) or output.place
        named = {self.extrinsics, self.intrinsics, self.mask or "", *self.maps}
        known = named.union(self.confidence.values(), *self.needed)
        file = NpzFile(path, memory, npz_fields(path) - known)  # others may be pickles
        own = next(name for name in self.maps if name in file.names())
        kind = self.maps[own]
        maps = self._masked(file, own, as_maps(file, own, 3 + (kind != "depth")))
        fields = {kind: maps} | self._cameras(file, maps.shape)
        if self.confidence[own] in file.names():
            fields["conf"] = as_maps(file, self.confidence[own], 3)
        return scene_of(path, file.budget, fields, self.views(output))

    def _cameras(self, file: NpzFile, shape: tuple[int, ...]) -> dict[str, Any]:
        """Return intrinsics and extrinsics where the file has them; `cameras` makes both."""
        if self.cameras is not None and not {self.extrinsics, self.intrinsics} <= file.names():
            return dict(zip(("intrinsics", "extrinsics"), self.cameras(file, shape), strict=True))
        found = {}
        for name, own in (("intrinsics", self.intrinsics), ("extrinsics", self.extrinsics)):
            if own in file.names():
                values = file.read(own)
                found[name] = values[0] if values.ndim == 4 and len(values) == 1 else values
        if self.camera_to_world and "extrinsics" in found:
            found["extrinsics"] = invert_poses(found["extrinsics"])
        return found

    def _masked(self, file: NpzFile, name: str, values: Any) -> Any:
        """Return maps that have no surface where the mask is False."""
        if self.mask is None or self.mask not in file.names() or values.dtype.kind != "f":
            return values
        mask = as_maps(file, self.mask, 3)
        if mask.dtype.kind != "b" or mask.shape != values.shape[:3]:
            what = f"field '{self.mask}' is {mask.dtype} of shape {mask.shape}"
            expected = f"bool of shape {values.shape[:3]}, that of '{name}'"
            raise PredictionError(what, where=file.path, expected=expected)

        def seen(row: int) -> Any:
            kept = mask[row].view(np.uint8) != 0
            return np.where(kept if values.ndim == 3 else kept[..., None], values[row], np.nan)

        return gather(range(len(values)), seen)
