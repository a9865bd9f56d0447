"""VPR-methods-evaluation: log folders score as the suite's own file of the same descriptors."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError, UserError
from tests.readers import retrieval_files as files
from tests.readers.retrieval_files import Place, made_scenes, perfect, scored, tile_file
from tests.support import MadeScene

ONE = made_scenes()[:1]


def test_an_exact_input_is_perfect(tmp_path: Path, home: Path) -> None:
    result = scored(files.write_vpr(tmp_path, Place()), home)
    assert perfect(result)
    reader = result.result.predictions.reader
    assert reader is not None
    assert reader.name == "vpr"
    assert "method salad" in reader.conventions[0]
    assert "names are taken by order" in reader.conventions[1]
    assert reader.conventions[1] in result.result.notes
    assert "compared by l2" in reader.conventions[2]


@pytest.mark.parametrize("labels", [False, True])
def test_lists_of_paths(tmp_path: Path, home: Path, labels: bool) -> None:
    for scene in Place().scenes:
        log = tmp_path / "logs" / scene.id
        files.write_log(log, scene)
        files.write_lists(log, Place(), scene, labels=labels)
    assert perfect(scored(tmp_path / "logs", home))


@pytest.mark.parametrize("lists", [False, True])
def test_an_order_by_positions_is_not_the_benchmarks(one: Path, log: Path, lists: bool) -> None:
    """With labels rows are sorted by what stands before the ids, as the lists say too."""
    place = Place(ONE)
    queries, tiles = place.descriptors(ONE[0])
    np.save(log / "queries_descriptors.npy", queries[::-1])
    np.save(log / "database_descriptors.npy", tiles[::-1])
    files.write_log(log, ONE[0], use_labels=not lists)
    if lists:
        files.write_lists(log, place, ONE[0], labels=True)
    with pytest.raises(PredictionError, match=log.name) as refused:
        scored(log, one)
    assert "--names" in str(refused.value)


@pytest.mark.parametrize("spoilt", ["none", "queries", "database"])
def test_an_assumed_order_is_held_against_the_lists(one: Path, log: Path, spoilt: str) -> None:
    files.write_lists(log, Place(ONE), ONE[0])
    if spoilt == "none":
        result = scored(log, one)
        assert perfect(result)
        assert not any("names are taken by order" in note for note in result.result.notes)
        return
    file = log / f"{spoilt}_descriptors.npy"
    np.save(file, np.roll(np.load(file), 1, axis=0))
    with pytest.raises(PredictionError, match="preds"):
        scored(log, one)


class TestNames:
    """Where the names of the rows come from."""

    def test_listing(self, tmp_path: Path, one: Path, log: Path) -> None:
        images = str(log / "images")
        files.write_images(images, ONE[0])
        tiles = Path(tile_file(images, ONE[0], 0)).parent
        for extra in ("tiles.csv", ".t00000.png", "t00000.tif", ".hidden/t.png"):
            (tiles / extra).parent.mkdir(exist_ok=True)
            (tiles / extra).touch()
        files.write_log(log, ONE[0], images)
        result = scored(log, one)
        assert perfect(result)
        assert "in the order of their paths" in result.result.predictions.reader.conventions[1]

    def test_folders_of_the_machine_are_not_listed(
        self, tmp_path: Path, one: Path, log: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A log of a stranger names a folder of this machine: nothing of it is read or told."""
        images = str(tmp_path / "private")
        files.write_images(images, ONE[0])
        (log / "images").symlink_to(images)
        gallery = np.eye(11, 24, dtype=np.float32)
        np.save(log / "database_descriptors.npy", gallery)
        seen: list[str] = []
        walk = os.walk

        def watched(top: str) -> Iterator[tuple[str, list[str], list[str]]]:
            seen.append(top)
            return walk(top)

        for home in (images, str(log / "images")):
            files.write_log(log, ONE[0], home, counts=(6, 11))
            with monkeypatch.context() as patch:
                patch.setattr(os, "walk", watched)
                with pytest.raises(UserError, match="without names") as refused:
                    scored(log, one)
            assert "12 images" not in str(refused.value)
        assert not any(os.path.realpath(place).startswith(images) for place in seen)

    def test_list_of_the_user(self, tmp_path: Path, one: Path, log: Path) -> None:
        order = np.random.default_rng(0).permutation(12)
        _, gallery = Place(ONE).descriptors(ONE[0])
        np.save(log / "database_descriptors.npy", gallery[order])
        listed = [f"x/t{number:05d}.png" for number in order]
        listed += [f"y/q{number:05d}.jpg" for number in range(6)]
        (tmp_path / "names.txt").write_text("\n".join(listed))
        assert perfect(scored(log, one, names=tmp_path / "names.txt"))
        for wrong, words in ((listed[1:], "17 names for 12"), ([*listed, "z"], "1 name more")):
            (tmp_path / "names.txt").write_text("\n".join(wrong))
            with pytest.raises(UserError, match=words):
                scored(log, one, names=tmp_path / "names.txt")

    def test_numbers_that_fit_two_scenes(self, tmp_path: Path) -> None:
        twins = [MadeScene(name, [[0], [1]], 3) for name in ("near", "far")]
        data = Place(twins).prepare(tmp_path / "data")
        files.write_log(tmp_path / "log", twins[0], database_folder="/x", queries_folder="/y")
        files.write_descriptors(tmp_path / "log", Place(twins), twins[0])
        with pytest.raises(UserError, match="without names"):
            scored(tmp_path / "log", data)
        (tmp_path / "log").rename(tmp_path / "near")
        with pytest.raises(UserError, match="lacks descriptors of tiles of scene far") as refused:
            scored(tmp_path / "near", data)
        assert "the folder that holds all runs" in str(refused.value)

    def test_the_innermost_scene_of_a_path_counts(self, tmp_path: Path, home: Path) -> None:
        """A run of all scenes below a folder that is called as one of them, and one of west."""
        whole = tmp_path / "east" / "all"
        place = Place()
        whole.mkdir(parents=True)
        pairs = [place.descriptors(scene) for scene in place.scenes]
        for at, name in enumerate(("queries", "database")):
            np.save(whole / f"{name}_descriptors.npy", np.concatenate([one[at] for one in pairs]))
        folders = {"database_folder": "/x", "queries_folder": "/y"}
        files.write_log(whole, place.scenes[0], counts=(10, 20), **folders)
        assert perfect(scored(whole, home))
        for scene in place.scenes:
            log = tmp_path / "east" / "runs" / scene.id
            files.write_log(log, scene)
            files.write_descriptors(log, place, scene)
        assert perfect(scored(tmp_path / "east" / "runs", home))


@pytest.mark.parametrize("lists", [False, True])
def test_two_runs_of_one_scene(tmp_path: Path, home: Path, lists: bool) -> None:
    place = Place()
    for name in ("first", "second"):
        files.write_log(tmp_path / "logs" / name, place.scenes[0])
        if lists:
            files.write_lists(tmp_path / "logs" / name, place, place.scenes[0])
        else:
            files.write_descriptors(tmp_path / "logs" / name, place, place.scenes[0])
    with pytest.raises(UserError, match=r"more than once|two runs of one query"):
        scored(tmp_path / "logs", home)


class TestRefusals:
    """What a run left incomplete, or was not of this benchmark."""

    @pytest.mark.parametrize("name", ["queries", "database"])
    def test_half_of_the_files(self, one: Path, log: Path, name: str) -> None:
        (log / f"{name}_descriptors.npy").unlink()
        with pytest.raises(UserError, match=f"lacks {name}_descriptors.npy"):
            scored(log, one)

    def test_only_wrong_lists(self, tmp_path: Path, one: Path) -> None:
        files.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        files.write_log(tmp_path / "log", ONE[0], save_only_wrong_preds=True)
        with pytest.raises(UserError, match="--save_only_wrong_preds leaves queries out"):
            scored(tmp_path / "log", one)

    def test_pickles_are_not_loaded(self, one: Path, log: Path) -> None:
        np.save(log / "database_descriptors.npy", np.array([{}], dtype=object))
        with pytest.raises(UserError, match="pickled Python objects, never loaded"):
            scored(log, one)
