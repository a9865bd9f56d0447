"""Where a method's own files of reconstructed scenes lie, and which photos their views are of.

A path is one scene's output, where the protocol has one scene or the path is named by its scene;
or a folder with such an output a scene, ``PATH/<scene>/...``.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.evaluation.reader import Reader, Reading, ReadPredictions
from airzoo_bench.readers.names import ImageNames, names_in, read_names

if TYPE_CHECKING:
    from airzoo_bench.reconstruction.predictions import ScenePrediction
    from airzoo_bench.reconstruction.truth import ReconstructionTruth

__all__ = ["ScenePlaces", "SceneReader", "find_scenes"]

_LOOKED_AT = 256
_NUMBER_AND_NAME = re.compile(r"(\d+(?:\.\d+)?)\s+(.+)")


@dataclass(frozen=True, eq=False)
class ScenePlaces:
    """Where the output of each scene is.

    Attributes
    ----------
    path : Path
    places : dict of str to Path
        By scene.
    others : tuple of str
        What belongs to no scene.
    reading : Reading
    """

    path: Path
    places: dict[str, Path]
    others: tuple[str, ...]
    reading: Reading

    def listed_names(self, place: Path) -> list[str] | None:
        """Return the names of views that ``--names`` lists of a scene; None without it."""
        return None if self.reading.names is None else self._of_place(self._names, place)

    def numbered_names(self, place: Path) -> dict[float, str]:
        """Return the listed names of a scene by number: ``number name`` in each line, or from 0."""
        lines = [_NUMBER_AND_NAME.fullmatch(line) for line in self._names]
        numbers = {line[2]: float(line[1]) for line in lines if line is not None}
        if len(numbers) < len(lines):
            return dict(enumerate(self._of_place(self._names, place)))
        names = self._of_place(list(numbers), place)
        found = {numbers[name]: name for name in names}
        if len(found) < len(names):
            raise PredictionError(
                f"gives {counted(len(names), 'photo')} {len(found):,} numbers",
                where=self.reading.names,
                expected="another number for each photo of a scene",
            )
        return found

    def _of_place(self, names: list[str], place: Path) -> list[str]:
        """Return the names that are of the scene at a place."""
        if len(self.places) == 1:
            return names
        scenes = zip(names, self._scenes(names), strict=True)
        return [name for name, one in scenes if self.places.get(one) == place]

    def photos(self, place: Path, names: Sequence[str]) -> list[str]:
        """Return the benchmark's names of the photos that names mean; others stay as they are."""
        scene = next(scene for scene, one in self.places.items() if one == place)
        truth = next((one for one in self.reading.truths if one.scene == scene), None)
        if truth is None:
            return list(names)
        images = dict(names_in([truth.photos]))
        found = self._named([truth]).find_all(names, place)
        return [
            name if one is None else images[one] for name, one in zip(names, found, strict=True)
        ]

    def photo_names(self, place: Path) -> list[str]:
        """Return the benchmark's names of the photos of a scene; none where it is missing."""
        scene = next(scene for scene, one in self.places.items() if one == place)
        truth = next((one for one in self.reading.truths if one.scene == scene), None)
        return [] if truth is None else truth.photos["image"].tolist()

    def _named(self, truths: Sequence[ReconstructionTruth]) -> ImageNames:
        return ImageNames.of(
            "photo",
            names_in(truth.photos for truth in truths),
            left_out=names_in(truth.excluded for truth in truths),
            scenes=self.reading.scenes,
        )

    @cached_property
    def _names(self) -> list[str]:
        return [] if self.reading.names is None else read_names(self.reading.names)

    def _scenes(self, names: list[str]) -> list[str]:
        """Return the scene of each listed name."""
        known = self._named(self.reading.truths)
        found = known.find_all(names, self.reading.names or self.path)
        lost = [repr(name) for name, one in zip(names, found, strict=True) if one is None]
        if lost:
            raise PredictionError(
                f"names that are of no photo, so that their scene is not known: {first_of(lost)}",
                where=self.reading.names,
                expected="the photos of all scenes, such as school/DJI_0001.JPG, a line each",
                fix="list each scene's photos in the order in which the method was given them",
            )
        return [one.split("/", 1)[0] for one in found if one is not None]


class SceneReader(Reader):
    """Reads what a method writes of a scene: the output of one scene, or a folder of them.

    `recognise` and `read` follow from how sure it is of one place, and how it reads one.
    """

    track = "reconstruction"
    takes_names = True

    @abstractmethod
    def sure_of(self, place: Path) -> float:
        """Say how sure it is that a file or folder is one scene's output, 0 to 1."""

    @abstractmethod
    def conventions(self, scenes: ScenePlaces) -> tuple[str, ...]:
        """Return what is taken to be so, see `ReadPredictions`."""

    @abstractmethod
    def read_scene(self, scenes: ScenePlaces, place: Path, memory: int) -> ScenePrediction:
        """Read the output of one scene."""

    def sure_within(self, place: Path) -> float:
        """Do the same for what lies in a folder of scenes' outputs."""
        return self.sure_of(place)

    def is_scene(self, place: Path) -> bool:
        """Say whether a place is read as one scene's output, once this reader is chosen."""
        return self.sure_of(place) > 0.0

    def recognise(self, path: Path) -> float:
        """See `Reader.recognise`."""
        try:
            found = self.sure_of(path)
            if found or not path.is_dir():
                return found
            return max(map(self.sure_within, islice(_children(path), _LOOKED_AT)), default=0.0)
        except OSError:  # a folder that may not be listed is nobody's
            return 0.0

    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """List the scenes; each is read when it is scored."""
        from airzoo_bench.reconstruction.predictions import NativeScenes

        scenes = find_scenes(path, reading, self.is_scene)

        def read_scene(place: Path, memory: int) -> ScenePrediction:
            return self.read_scene(scenes, place, memory)

        predictions = NativeScenes(path, scenes.places, read_scene, scenes.others)
        return ReadPredictions(predictions, self.conventions(scenes))


def find_scenes(path: Path, reading: Reading, is_scene: Callable[[Path], bool]) -> ScenePlaces:
    """Find the output of each scene; refuse none, one of an unknown scene, and two of a scene."""
    known = [scene.id for scene in reading.protocol.scenes]
    if is_scene(path):
        return ScenePlaces(path, {_only_scene(path, known): path}, (), reading)
    places: dict[str, Path] = {}
    others = []
    for child in _children(path) if path.is_dir() else ():
        if not is_scene(child):
            others.append(child.name)
        elif _scene_name(child) in places:
            raise PredictionError(
                f"scene {_scene_name(child)!r} has two outputs: {places[_scene_name(child)].name} "
                f"and {child.name}",
                where=path,
                expected="one a scene",
                fix="keep one of the two",
            )
        else:
            places[_scene_name(child)] = child
    if not places:
        raise PredictionError(
            "holds no scene's output that this reader reads",
            where=path,
            expected=f"a folder a scene, such as {path.name}/{known[0]}/, each as the method wrote "
            "it",
            fix="`airzoo-bench readers` says what each reader recognises",
        )
    return ScenePlaces(path, places, tuple(others), reading)


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


def _children(path: Path) -> Iterator[Path]:
    return iter(sorted(one for one in path.iterdir() if not one.name.startswith(".")))
