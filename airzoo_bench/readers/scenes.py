"""Readers of reconstructions: they find the outputs of scenes and the photos of views.

A path is one scene's output, where the protocol has one scene or the path is named by its scene;
or a folder with such an output a scene, ``PATH/<scene>/...``. A reader has layouts of outputs.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.ids import IMAGE_SUFFIXES
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions
from airzoo_bench.readers.names import ImageNames, names_in, read_names
from airzoo_bench.reconstruction.predictions import NativeScenes, ScenePrediction
from airzoo_bench.reconstruction.truth import ReconstructionTruth

_LOOKED_AT = 256
_BY_NAME = "the scene's photos in the order of their names, which poses must fit"
_IN_ORDER = "list the photos in the order in which the method was given them, a line each"


@dataclass(frozen=True)
class SceneOutput:
    """One scene's output: a file or a folder, `alone` where the path has no other."""

    place: Path
    scene: str
    reading: Reading
    alone: bool = True

    def view_names(self, beside: Path | None = None) -> ViewNames | None:
        """Name the views by ``--names``, else by the sorted images in a folder beside them."""
        listed = self.reading.names
        if listed is not None:
            names = self.photos(self._of_scene(read_names(listed)))
            return ViewNames(names, f"in {listed}", f"named by {listed.name}, in its order")
        found = _sorted_images(beside)
        if beside is None or not found:
            return None
        said = f"named by the images in {beside.name}/, sorted by name"
        return ViewNames(self.photos(found), f"of images in {beside}", said)

    def numbered_photos(self) -> dict[float, str]:
        """Return the photos that ``--names`` lists by number: ``number name``, or lines from 0."""
        listed = read_names(self.reading.names or self.place)
        lines = [re.fullmatch(r"(\d+(?:\.\d+)?)\s+(.+)", line) for line in listed]
        numbers = {line[2]: float(line[1]) for line in lines if line is not None}
        if len(numbers) < len(lines):
            return dict(enumerate(self.photos(self._of_scene(listed))))
        names = self._of_scene(list(numbers))
        return dict(zip((numbers[name] for name in names), self.photos(names), strict=True))

    def photos(self, names: Sequence[str]) -> list[str]:
        """Return the benchmark's names of the photos that names mean; others stay as they are."""
        truths = [one for one in self.reading.truths if one.scene == self.scene]
        if not truths:
            return list(names)
        images = dict(names_in([truths[0].photos]))
        found = _photo_names(truths, self.reading).find_all(names, self.place)
        return [images.get(str(one), name) for name, one in zip(names, found, strict=True)]

    def photos_of_scene(self) -> list[str]:
        """Return the benchmark's names of the scene's photos; none where it is missing."""
        truths = (one for one in self.reading.truths if one.scene == self.scene)
        return [image for truth in truths for image in truth.photos["image"].tolist()]

    def _of_scene(self, names: list[str]) -> list[str]:
        """Return the listed names that are of this scene."""
        if self.alone:
            return names
        where = self.reading.names or self.place
        found = _photo_names(self.reading.truths, self.reading).find_all(names, where)
        lost = [repr(name) for name, one in zip(names, found, strict=True) if one is None]
        if lost:
            raise PredictionError(
                f"names that are of no photo, so that their scene is not known: {first_of(lost)}",
                where=where,
                expected="the photos of all scenes, such as school/DJI_0001.JPG, a line each",
                fix=_IN_ORDER,
            )
        scenes = (str(one).split("/", 1)[0] for one in found)
        return [name for name, scene in zip(names, scenes, strict=True) if scene == self.scene]


def _photo_names(truths: Sequence[ReconstructionTruth], reading: Reading) -> ImageNames:
    photos = names_in(truth.photos for truth in truths)
    left_out = names_in(truth.excluded for truth in truths)
    return ImageNames("photo", photos, left_out=left_out, scenes=reading.scenes)


def _sorted_images(folder: Path | None) -> list[str]:
    """Return the names of the images in a folder, sorted; none where there is no such folder."""
    names = [one.name for one in _children(folder)] if folder is not None else []
    return [name for name in names if name.lower().endswith(IMAGE_SUFFIXES)]


@dataclass(frozen=True)
class ViewNames:
    """Photos of a scene's views in their order, as the benchmark names them.

    `source` is where names are from, `said` how they are, for a reader's conventions.
    """

    names: list[str]
    source: str = ""
    said: str = ""

    def check(self, path: Path, count: int) -> None:
        """Refuse names of another number than the views."""
        if len(self.names) != count:
            raise PredictionError(
                f"holds {counted(count, 'view')}, and there are {len(self.names):,} names "
                f"{self.source}",
                where=path,
                expected="the name of each view",
                fix=f"{_IN_ORDER}, and give the list with --names",
            )


class Layout(ABC):
    """A layout of a scene's output; `said` are conventions, see `ReadPredictions`."""

    said: tuple[str, ...] = ()

    @abstractmethod
    def sure(self, place: Path) -> float:
        """Say how sure it is that a file or folder is one scene's output, 0 to 1."""

    def accepts(self, place: Path) -> bool:
        """Say whether a place is read once its reader is chosen."""
        return self.sure(place) > 0.0

    def views(self, output: SceneOutput) -> ViewNames | None:
        """Name the views; None if they are the scene's photos in the order of their names."""
        return output.view_names()

    def order(self, output: SceneOutput) -> str:
        """Say which photo each view is of, for a reader's conventions."""
        names = self.views(output)
        return f"views are {names.said if names else _BY_NAME}"

    @abstractmethod
    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        """Read the output of one scene."""


@dataclass(frozen=True)
class Refused(Layout):
    """An output that cannot be scored; the fix names one that can."""

    knows: Callable[[Path], bool]
    what: str
    expected: str
    fix: str  # PLACE in it is the path

    def sure(self, place: Path) -> float:
        """See `Layout.sure`."""
        return 0.9 * self.knows(place)

    def read(self, output: SceneOutput, memory: int) -> ScenePrediction:
        """See `Layout.read`; it refuses."""
        fix = self.fix.replace("PLACE", str(output.place))
        raise PredictionError(self.what, where=output.place, expected=self.expected, fix=fix)


class SceneReader(Reader):
    """Reads what a method writes of a scene: the output of one scene, or a folder of them."""

    track = "reconstruction"
    takes_names = True

    def __init__(self, title: str, layout: str, methods: tuple[str, ...], *layouts: Layout) -> None:
        self.title, self.layout, self.methods = title, layout, methods  # type: ignore[misc]
        self.layouts = layouts

    def sure(self, place: Path) -> float:
        """Say how sure it is that a file or folder is one scene's output."""
        return max(layout.sure(place) for layout in self.layouts)

    def sure_within(self, place: Path) -> float:
        """Do the same for what lies in a folder of scenes' outputs."""
        return self.sure(place)

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        try:
            found = self.sure(path)
            some = _children(path)[:_LOOKED_AT] if not found else []
            return max(map(self.sure_within, some), default=found)
        except OSError:  # a folder that may not be listed is nobody's
            return 0.0

    def layout_of(self, place: Path) -> Layout | None:
        """Return the layout that a place has."""
        return next((layout for layout in self.layouts if layout.accepts(place)), None)

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """List the scenes; each is read when it is scored."""
        whole = self.layout_of(path)
        if isinstance(whole, Refused):
            whole.read(SceneOutput(path, "", reading), 0)
        outputs, others = find_outputs(path, reading, lambda one: self.layout_of(one) is not None)

        def read_scene(place: Path, memory: int) -> ScenePrediction:
            layout = self.layout_of(place)
            if layout is None:
                raise PredictionError("is no output of a scene any more", where=place)
            return layout.read(outputs[place], memory)

        places = {output.scene: place for place, output in outputs.items()}
        predictions = NativeScenes(path, places, read_scene, others)
        place, output = next(iter(outputs.items()))
        first = self.layout_of(place)
        said = () if first is None else (*first.said, first.order(output))
        return ReadPredictions(predictions, said)


def find_outputs(
    path: Path, reading: Reading, is_output: Callable[[Path], bool]
) -> tuple[dict[Path, SceneOutput], tuple[str, ...]]:
    """Find each scene's output by its place, and what is none; refuse none, and two of a scene."""
    known = [scene.id for scene in reading.protocol.scenes]
    if is_output(path):
        return {path: SceneOutput(path, _only_scene(path, known), reading)}, ()
    children = _children(path)
    found = [child for child in children if is_output(child)]
    scenes = [_scene_name(child) for child in found]
    twice = next((one for one in scenes if scenes.count(one) > 1), None)
    if not found or twice is not None:
        what = "holds no scene's output that this reader reads"
        if twice is not None:
            names = [one.name for one in found if _scene_name(one) == twice]
            what = f"scene {twice!r} has two outputs: {' and '.join(names)}"
        raise PredictionError(
            what,
            where=path,
            expected=f"a folder a scene, such as {path.name}/{known[0]}/, as the method wrote it",
            fix="`airzoo-bench readers` says what each reader recognises",
        )
    pairs = zip(found, scenes, strict=True)
    outputs = {one: SceneOutput(one, scene, reading, len(found) == 1) for one, scene in pairs}
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
