"""Where the outputs of scenes are found, and which photos names mean."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import Reading
from airzoo_bench.readers.scene_folders import ScenePlaces, SceneReader, find_scenes

PHOTOS = {"yard": ["a/1.JPG", "a/2.JPG"], "lot": ["1.JPG", "3.JPG"]}


def truth(scene: str) -> Any:
    images = PHOTOS[scene]
    ids = [f"{scene}/{name.removesuffix('.JPG')}" for name in images]
    left_out = pd.DataFrame({"id": [f"{scene}/8"], "image": ["8.JPG"]})
    photos = pd.DataFrame({"id": ids, "image": images})
    return SimpleNamespace(scene=scene, photos=photos, excluded=left_out)


def reading(*scenes: str, names: Path | None = None, truths: bool = True) -> Reading:
    protocol: Any = SimpleNamespace(scenes=[SimpleNamespace(id=scene) for scene in scenes])
    known = [truth(one) for one in scenes] if truths else []
    return Reading(protocol, known, names, 1 << 20, scenes=(*scenes, "dock"))


def is_scene(place: Path) -> bool:
    return (place / "out.txt").is_file() or place.suffix == ".out"


class Outputs(SceneReader):
    title, layout = "outputs", "out.txt"

    def sure_of(self, place: Path) -> float:
        return 0.9 * is_scene(place)

    def conventions(self, scenes: ScenePlaces) -> tuple[str, ...]:
        return (f"scenes are {', '.join(scenes.places)}",)

    def read_scene(self, scenes: ScenePlaces, place: Path, memory: int) -> Any:
        return scenes.reading, place, memory


def output(place: Path) -> Path:
    place.mkdir(parents=True)
    (place / "out.txt").touch()
    return place


def test_one_output_is_of_the_only_scene_or_of_that_which_names_it(tmp_path: Path) -> None:
    place = output(tmp_path / "lot")
    assert find_scenes(place, reading("yard"), is_scene).places == {"yard": place}
    assert find_scenes(place, reading("yard", "lot"), is_scene).places == {"lot": place}
    with pytest.raises(PredictionError, match="output of one scene, and the protocol has 2"):
        find_scenes(output(tmp_path / "x"), reading("yard", "lot"), is_scene)


def test_a_folder_of_outputs(tmp_path: Path) -> None:
    place = output(tmp_path / "yard")
    (tmp_path / "lot.out").touch()
    (tmp_path / ".hidden").touch()
    (tmp_path / "log.txt").touch()
    found = find_scenes(tmp_path, reading("yard", "lot"), is_scene)
    assert found.places == {"lot": tmp_path / "lot.out", "yard": place}
    assert found.others == ("log.txt",)
    assert Outputs().recognise(tmp_path) == 0.9
    assert Outputs().recognise(place) == 0.9
    assert Outputs().recognise(tmp_path / "log.txt") == 0.0
    (tmp_path / "yard.out").touch()
    with pytest.raises(PredictionError, match=r"'yard' has two outputs: yard and yard\.out"):
        find_scenes(tmp_path, reading("yard", "lot"), is_scene)


def test_scenes_are_read_when_they_are_asked_for(tmp_path: Path) -> None:
    place, given = output(tmp_path / "yard"), reading("yard")
    read = Outputs().read(place, given)
    assert read.conventions == ("scenes are yard",)
    with read.predictions.opened("yard", limit_bytes=7, sampling=None) as scene:
        assert scene == (given, place, 7)


def test_nothing_found(tmp_path: Path) -> None:
    with pytest.raises(PredictionError, match="holds no scene's output"):
        find_scenes(tmp_path, reading("yard"), is_scene)


def test_names_mean_photos_of_their_scene(tmp_path: Path) -> None:
    yard, lot = output(tmp_path / "p" / "yard"), output(tmp_path / "p" / "lot")
    names = tmp_path / "names.txt"
    names.write_text("lot/3.JPG\n/data/yard/images/a/2.JPG\nlot/1.JPG\nyard/a/1.JPG\n")
    found = find_scenes(tmp_path / "p", reading("yard", "lot", names=names), is_scene)
    assert found.listed_names(lot) == ["lot/3.JPG", "lot/1.JPG"]
    assert found.photos(lot, ["lot/3.JPG", "x.png"]) == ["3.JPG", "x.png"]
    assert found.photos(yard, found.listed_names(yard) or []) == ["a/2.JPG", "a/1.JPG"]
    names.write_text("lot/3.JPG\nyard/b/9.JPG\n")
    found = find_scenes(tmp_path / "p", reading("yard", "lot", names=names), is_scene)
    with pytest.raises(PredictionError, match="no photo, so that their scene is not known"):
        found.listed_names(lot)


@pytest.mark.parametrize("line", ["yard/3.JPG", "dock/3.JPG", "lot/8.JPG"])
def test_photos_of_other_scenes_and_those_left_out_are_no_photos(tmp_path: Path, line: str) -> None:
    lot = output(tmp_path / "p" / "lot")
    output(tmp_path / "p" / "yard")
    names = tmp_path / "names.txt"
    names.write_text(f"lot/1.JPG\nyard/a/1.JPG\n{line}\n")
    found = find_scenes(tmp_path / "p", reading("yard", "lot", names=names), is_scene)
    assert found.photos(lot, ["lot/1.JPG", line]) == ["1.JPG", line]
    with pytest.raises(PredictionError, match="no photo, so that their scene is not known"):
        found.listed_names(lot)


def test_names_without_a_benchmark_stay(tmp_path: Path) -> None:
    place = output(tmp_path / "yard")
    found = find_scenes(place, reading("yard", truths=False), is_scene)
    assert found.listed_names(place) is None
    assert found.photos(place, ["z.png"]) == ["z.png"]
