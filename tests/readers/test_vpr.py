"""VPR-methods-evaluation: log folders score as the suite's own file of the same descriptors."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError, UserError
from tests.readers.retrieval_support import (
    Place,
    made_scenes,
    perfect,
    scored,
    tile_file,
)
from tests.readers.samples import vpr
from tests.support import MadeScene

ONE = made_scenes()[:1]


def test_an_exact_input_is_perfect(tmp_path: Path, home: Path) -> None:
    result = scored(vpr.write(tmp_path, Place()), home)
    assert perfect(result)
    reader = result.result.predictions.reader
    assert reader is not None
    assert reader.name == "vpr"
    assert "method salad" in reader.conventions[0]
    assert "names are taken by order" in reader.conventions[1]
    assert reader.conventions[1] in result.result.notes
    assert "L2 distance" in reader.conventions[2]


@pytest.mark.parametrize("labels", [False, True])
def test_lists_of_paths(tmp_path: Path, home: Path, labels: bool) -> None:
    for scene in Place().scenes:
        log = tmp_path / "logs" / scene.id
        vpr.write_log(log, scene)
        vpr.write_lists(log, Place(), scene, labels=labels)
    assert perfect(scored(tmp_path / "logs", home))


def test_photos_of_another_scene_are_no_queries(tmp_path: Path, home: Path) -> None:
    """West has a photo that is no query of it, and is called as one of east's is."""
    place = Place([MadeScene("east", [], 12), MadeScene("west", [[0]] * 5, 8)])
    log = tmp_path / "log"
    vpr.write_log(log, place.scenes[1], database_folder="/data/all", counts=(5, 8))
    vpr.write_lists(log, place, place.scenes[1])
    result = scored(log, home)
    assert result.records.groupby("scene")["answered"].sum().to_dict() == {"east": 0, "west": 4}
    assert any("1 photo described that are no queries" in note for note in result.result.notes)


@pytest.mark.parametrize("lists", [False, True])
def test_an_order_by_positions_is_not_the_benchmarks(one: Path, log: Path, lists: bool) -> None:
    """With labels rows are sorted by what stands before the ids, as the lists say too."""
    place = Place(ONE)
    queries, tiles = place.descriptors(ONE[0])
    np.save(log / "queries_descriptors.npy", queries[::-1])
    np.save(log / "database_descriptors.npy", tiles[::-1])
    vpr.write_log(log, ONE[0], use_labels=not lists)
    if lists:
        vpr.write_lists(log, place, ONE[0], labels=True)
    with pytest.raises(PredictionError, match=log.name) as refused:
        scored(log, one)
    assert "--names" in str(refused.value)


@pytest.mark.parametrize("spoilt", ["none", "queries", "database"])
def test_an_assumed_order_is_held_against_the_lists(one: Path, log: Path, spoilt: str) -> None:
    vpr.write_lists(log, Place(ONE), ONE[0])
    if spoilt == "none":
        result = scored(log, one)
        assert perfect(result)
        assert not any("names are taken by order" in note for note in result.result.notes)
        return
    file = log / f"{spoilt}_descriptors.npy"
    np.save(file, np.roll(np.load(file), 1, axis=0))
    with pytest.raises(PredictionError, match="preds"):
        scored(log, one)


class Renamed(MadeScene):
    """A scene whose photos are called a00000 in west and b00000 elsewhere."""

    def query(self, number: int) -> str:
        return f"{self.id}/{'ba'[self.id == 'west']}{number:05d}"


class TestNames:
    """Where the names of the rows come from."""

    def test_listing(self, tmp_path: Path, one: Path, log: Path) -> None:
        images = str(log / "images")
        vpr.write_images(images, ONE[0])
        tiles = Path(tile_file(images, ONE[0], 0)).parent
        for extra in ("tiles.csv", ".t00000.png", "t00000.tif", ".hidden/t.png"):
            (tiles / extra).parent.mkdir(exist_ok=True)
            (tiles / extra).touch()
        vpr.write_log(log, ONE[0], images)
        result = scored(log, one)
        assert perfect(result)
        assert "in the order of their paths" in result.result.predictions.reader.conventions[1]

    def test_folders_of_the_machine_are_not_listed(
        self, tmp_path: Path, one: Path, log: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A log of a stranger names a folder of this machine: nothing of it is read or told."""
        images = str(tmp_path / "private")
        vpr.write_images(images, ONE[0])
        (log / "images").symlink_to(images)
        gallery = np.eye(11, 24, dtype=np.float32)
        np.save(log / "database_descriptors.npy", gallery)
        seen: list[str] = []
        walk = os.walk

        def watched(top: str) -> Iterator[tuple[str, list[str], list[str]]]:
            seen.append(top)
            return walk(top)

        for home in (images, str(log / "images")):
            vpr.write_log(log, ONE[0], home, counts=(6, 11))
            with monkeypatch.context() as patch:
                patch.setattr(os, "walk", watched)
                with pytest.raises(UserError, match="fit no scene") as refused:
                    scored(log, one)
            assert "12 images" not in str(refused.value)
        assert not any(os.path.realpath(place).startswith(images) for place in seen)

    def test_another_number_of_images_is_refused(
        self, tmp_path: Path, one: Path, log: Path
    ) -> None:
        images = str(log / "images")
        vpr.write_images(images, ONE[0])
        Path(tile_file(images, ONE[0], 3)).unlink()
        vpr.write_log(log, ONE[0], images)
        with pytest.raises(UserError, match=r"11 images for 12 rows"):
            scored(log, one)

    def test_file_of_paths(self, tmp_path: Path, one: Path, log: Path) -> None:
        images = str(log / "images")
        vpr.write_images(images, ONE[0])
        order = np.random.default_rng(0).permutation(12)
        tiles = Path(tile_file(images, ONE[0], 0)).parent
        listed = "".join(f"t{number:05d}.png\n" for number in order)
        Path(f"{tiles}_images_paths.txt").write_text(listed)
        vpr.write_log(log, ONE[0], images)
        assert not perfect(scored(log, one))
        _, gallery = Place(ONE).descriptors(ONE[0])
        np.save(log / "database_descriptors.npy", gallery[order])
        result = scored(log, one)
        assert perfect(result)
        reader = result.result.predictions.reader
        assert "_images_paths.txt" in reader.conventions[1]
        assert not any("read too" in said for said in reader.conventions)

    def test_a_file_of_paths_beside_the_benchmarks_images_is_stated(
        self, one: Path, log: Path
    ) -> None:
        """It decides which row is which tile, and the checksum of the predictions is without it."""
        images = str(one / "made" / "images")
        vpr.write_images(images, ONE[0])
        tiles = Path(tile_file(images, ONE[0], 0)).parent
        listed = "".join(f"t{number:05d}.png\n" for number in range(12))
        file = Path(f"{tiles}_images_paths.txt")
        file.write_text(listed)
        vpr.write_log(log, ONE[0], images)
        reader = scored(log, one).result.predictions.reader
        sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
        assert f"read too: {file.name}, SHA-256 {sha256}" in reader.conventions

    def test_listing_of_images_with_positions(self, one: Path, log: Path) -> None:
        """Their order is that of the positions."""
        images = str(log / "images")
        vpr.write_images(images, ONE[0])
        for image in [path for path in Path(images).rglob("*.*") if path.is_file()]:
            image.rename(vpr.labelled(str(image)))
        vpr.write_log(log, ONE[0], images, use_labels=True)
        for name in ("queries", "database"):
            file = log / f"{name}_descriptors.npy"
            np.save(file, np.load(file)[::-1])
        assert perfect(scored(log, one))

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

    def test_numbers_that_fit_no_scene(self, one: Path, log: Path) -> None:
        np.save(log / "database_descriptors.npy", np.eye(11, 24, dtype=np.float32))
        vpr.write_log(log, ONE[0], counts=(6, 11))
        with pytest.raises(UserError, match="fit no scene"):
            scored(log, one)

    def test_numbers_that_fit_two_scenes(self, tmp_path: Path) -> None:
        twins = [MadeScene(name, [[0], [1]], 3) for name in ("near", "far")]
        data = Place(twins).prepare(tmp_path / "data")
        vpr.write_log(tmp_path / "log", twins[0], database_folder="/x", queries_folder="/y")
        vpr.write_descriptors(tmp_path / "log", Place(twins), twins[0])
        with pytest.raises(UserError, match="could be several scenes"):
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
        vpr.write_log(whole, place.scenes[0], counts=(10, 20), **folders)
        assert perfect(scored(whole, home))
        for scene in place.scenes:
            log = tmp_path / "east" / "runs" / scene.id
            vpr.write_log(log, scene)
            vpr.write_descriptors(log, place, scene)
        assert perfect(scored(tmp_path / "east" / "runs", home))

    def test_lists_below_a_folder_that_is_called_as_another_scene(
        self, tmp_path: Path, home: Path
    ) -> None:
        """Names that say their scene say more than the folder that the log lies in."""
        west = Place().scenes[1]
        log = tmp_path / "east" / "log"
        vpr.write_log(log, west, database_folder="/data/all", queries_folder="/data/all")
        vpr.write_lists(log, Place(), west)
        answered = scored(log, home).records.groupby("scene")["answered"].sum().to_dict()
        assert answered == {"east": 0, "west": 4}

    def test_an_order_that_depends_on_folders_is_not_guessed(self, tmp_path: Path) -> None:
        """Photos of two scenes in one folder, whose names are unlike: east has b, west has a."""
        scenes = [Renamed("east", [[0]] * 2, 3), Renamed("west", [[0]] * 3, 4)]
        data = Place(scenes).prepare(tmp_path / "data")
        log = tmp_path / "log"
        vpr.write_log(log, scenes[0], database_folder="/x", queries_folder="/y", counts=(5, 7))
        np.save(log / "queries_descriptors.npy", np.eye(5, 24, dtype=np.float32))
        np.save(log / "database_descriptors.npy", np.eye(7, 24, dtype=np.float32))
        with pytest.raises(UserError, match="all in one folder they have another order"):
            scored(log, data)

    def test_other_photos_are_left_aside(self, tmp_path: Path, one: Path, log: Path) -> None:
        queries, _ = Place(ONE).descriptors(ONE[0])
        np.save(log / "queries_descriptors.npy", np.concatenate([queries[:1] * 0.5, queries]))
        vpr.write_log(log, ONE[0], counts=(7, 12))
        listed = [f"t{number:05d}.png" for number in range(12)]
        listed += ["no_query.jpg", *(f"q{number:05d}.jpg" for number in range(6))]
        (tmp_path / "names.txt").write_text("\n".join(listed))
        result = scored(log, one, names=tmp_path / "names.txt")
        assert perfect(result)
        assert any("1 photo described that" in note for note in result.result.notes)


def test_a_gallery_larger_than_the_memory(tmp_path: Path) -> None:
    scene = MadeScene("east", [[0]], 400)
    data = Place([scene]).prepare(tmp_path / "data")
    rows = np.random.default_rng(0).standard_normal((400, 5000), np.float32)
    vpr.write_log(tmp_path / "log", scene)
    np.save(tmp_path / "log" / "database_descriptors.npy", rows)
    np.save(tmp_path / "log" / "queries_descriptors.npy", rows[:1])
    assert rows.nbytes > 4e6
    assert scored(tmp_path / "log", data, max_memory=2_000_000).overall["recall@1"] == 1.0


def test_a_run_that_broke_off_is_left_aside(tmp_path: Path, home: Path) -> None:
    """It has a log alone; the one after it, beside it, is whole."""
    logs = vpr.write(tmp_path, Place())
    vpr.write_log(logs / "west" / "2026-11-22_18-00-00", Place().scenes[1])
    result = scored(logs, home)
    assert perfect(result)
    assert any("left aside: 1 (west/2026-11-22_18" in note for note in result.result.notes)


@pytest.mark.parametrize("lists", [False, True])
def test_two_runs_of_one_scene(tmp_path: Path, home: Path, lists: bool) -> None:
    place = Place()
    for name in ("first", "second"):
        vpr.write_log(tmp_path / "logs" / name, place.scenes[0])
        if lists:
            vpr.write_lists(tmp_path / "logs" / name, place, place.scenes[0])
        else:
            vpr.write_descriptors(tmp_path / "logs" / name, place, place.scenes[0])
    with pytest.raises(UserError, match=r"second: is a second run of what .*first answers: east/q"):
        scored(tmp_path / "logs", home)


class TestRefusals:
    """What a run left incomplete, or was not of this benchmark."""

    @pytest.mark.parametrize("name", ["queries", "database"])
    def test_half_of_the_files(self, one: Path, log: Path, name: str) -> None:
        (log / f"{name}_descriptors.npy").unlink()
        with pytest.raises(UserError, match=f"lacks {name}_descriptors.npy"):
            scored(log, one)

    def test_only_wrong_lists(self, tmp_path: Path, one: Path) -> None:
        vpr.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        vpr.write_log(tmp_path / "log", ONE[0], save_only_wrong_preds=True)
        with pytest.raises(UserError, match="--save_only_wrong_preds leaves queries out"):
            scored(tmp_path / "log", one)

    def test_a_list_that_is_lacking(self, tmp_path: Path, one: Path) -> None:
        vpr.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        (tmp_path / "log" / "preds" / "002.txt").unlink()
        with pytest.raises(UserError, match=r"lacks the lists of 1 of 6 queries \(2\)"):
            scored(tmp_path / "log", one)

    def test_tiles_of_elsewhere(self, tmp_path: Path, one: Path) -> None:
        vpr.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        file = tmp_path / "log" / "preds" / "000.txt"
        file.write_text(file.read_text().replace("t00000.png", "map.png"))
        with pytest.raises(UserError, match=r"ranks what is no tile: 1 .*map.png"):
            scored(tmp_path / "log", one)

    def test_pickles_are_not_loaded(self, one: Path, log: Path) -> None:
        np.save(log / "database_descriptors.npy", np.array([{}], dtype=object))
        with pytest.raises(UserError, match="pickled Python objects, never loaded"):
            scored(log, one)
