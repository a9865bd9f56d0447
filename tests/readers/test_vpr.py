"""VPR-methods-evaluation: log folders score as the suite's own file of the same descriptors."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.retrieval.descriptor_rows import RowParts
from tests.readers.retrieval_support import (
    Place,
    made_scenes,
    perfect,
    photo_file,
    scored,
    tile_file,
)
from tests.readers.samples import vpr
from tests.support import MadeScene

ONE = made_scenes()[:1]


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return Place().prepare(tmp_path / "data")


@pytest.fixture
def one(tmp_path: Path) -> Path:
    """Return the data root of a benchmark of one scene."""
    return Place(ONE).prepare(tmp_path / "data")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Return a log folder for one scene, whose images are not on this machine."""
    vpr.write_log(tmp_path / "log", ONE[0])
    vpr.write_descriptors(tmp_path / "log", Place(ONE), ONE[0])
    return tmp_path / "log"


def test_an_exact_input_is_perfect(tmp_path: Path, home: Path) -> None:
    result = scored(vpr.write(tmp_path, Place()), home)
    assert perfect(result)
    reader = result.result.predictions.reader
    assert reader is not None
    assert reader.name == "vpr"
    assert "method salad" in reader.conventions[0]
    assert "names are taken by order" in reader.conventions[1]
    assert "L2 distance" in reader.conventions[2]


def test_the_score_is_that_of_the_canonical_file(tmp_path: Path, home: Path) -> None:
    place = Place(noise=0.4)
    ours = scored(place.canonical(tmp_path / "own.npz"), home)
    theirs = scored(vpr.write(tmp_path, place), home)
    assert not perfect(ours)
    assert theirs.overall == ours.overall
    assert theirs.records.equals(ours.records)


@pytest.mark.parametrize("labels", [False, True])
def test_lists_of_paths(tmp_path: Path, home: Path, labels: bool) -> None:
    for scene in Place().scenes:
        log = tmp_path / "logs" / scene.id
        vpr.write_log(log, scene)
        vpr.write_lists(log, Place(), scene, labels=labels)
    assert perfect(scored(tmp_path / "logs", home))


def test_a_part_of_a_folder_is_refused_as_such(one: Path, log: Path) -> None:
    with pytest.raises(UserError, match="a part of a log folder of VPR") as refused:
        scored(log / "database_descriptors.npy", one)
    assert f"name the folder: {log}" in str(refused.value)


class TestNames:
    """Where the names of the rows come from."""

    def test_listing(self, tmp_path: Path, one: Path, log: Path) -> None:
        images = str(log / "images")
        vpr.write_images(images, ONE[0])
        vpr.write_log(log, ONE[0], images)
        result = scored(log, one)
        assert perfect(result)
        assert "in the order of their paths" in result.result.predictions.reader.conventions[1]

    def test_listing_is_of_the_images_that_the_method_takes(
        self, tmp_path: Path, one: Path, log: Path
    ) -> None:
        images = str(log / "images")
        vpr.write_images(images, ONE[0])
        tiles = Path(tile_file(images, ONE[0], 0)).parent
        for extra in ("tiles.csv", ".t00000.png", "t00000.tif", ".hidden/t.png"):
            (tiles / extra).parent.mkdir(exist_ok=True)
            (tiles / extra).touch()
        vpr.write_log(log, ONE[0], images)
        assert perfect(scored(log, one))

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

    def test_photos_of_the_benchmark_are_listed(self, one: Path, log: Path) -> None:
        photos = Path(photo_file(str(one / "made" / "images"), ONE[0], 0)).parent
        vpr.write_images(str(one / "made" / "images"), ONE[0])
        vpr.write_log(log, ONE[0], str(one / "made" / "images"))
        assert photos.is_dir()
        result = scored(log, one)
        assert perfect(result)
        assert "in the order of their paths" in result.result.predictions.reader.conventions[1]

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
        assert "_images_paths.txt" in result.result.predictions.reader.conventions[1]

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
        with pytest.raises(UserError, match="lacks descriptors of tiles of scene far"):
            scored(tmp_path / "near", data)

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


@pytest.mark.parametrize("folder", ["x" * 5000, "/dev/null", "", "\\x00", "a'b"])
def test_folders_that_are_none(one: Path, log: Path, folder: str) -> None:
    vpr.write_log(log, ONE[0], database_folder=folder)
    assert perfect(scored(log, one))


def test_a_run_that_saved_nothing(tmp_path: Path, one: Path) -> None:
    vpr.write_log(tmp_path / "log", ONE[0])
    with pytest.raises(UserError, match="neither descriptors nor lists"):
        scored(tmp_path / "log", one)


class TestRefusals:
    """What a run left incomplete, or was not of this benchmark."""

    def test_counts_of_another_run(self, one: Path, log: Path) -> None:
        vpr.write_log(log, ONE[0], counts=(6, 13))
        with pytest.raises(UserError, match=r"info.log speaks of 6 and 13"):
            scored(log, one)

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

    def test_a_cut_list(self, tmp_path: Path, one: Path) -> None:
        vpr.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        (tmp_path / "log" / "preds" / "002.txt").write_text("Query path:\na.jpg\n")
        with pytest.raises(UserError, match="damaged one"):
            scored(tmp_path / "log", one)

    def test_tiles_of_elsewhere(self, tmp_path: Path, one: Path) -> None:
        vpr.write_lists(tmp_path / "log", Place(ONE), ONE[0])
        file = tmp_path / "log" / "preds" / "000.txt"
        file.write_text(file.read_text().replace("t00000.png", "map.png"))
        with pytest.raises(UserError, match=r"ranks what is no tile: 1 .*map.png"):
            scored(tmp_path / "log", one)

    def test_two_methods(self, tmp_path: Path, home: Path) -> None:
        logs = vpr.write(tmp_path, Place())
        vpr.write_log(next((logs / "west").iterdir()), Place().scenes[1], method="boq")
        with pytest.raises(UserError, match=r"runs of several methods: 2 .boq, salad"):
            scored(logs, home)

    def test_lengths_that_differ(self, tmp_path: Path, home: Path) -> None:
        logs = vpr.write(tmp_path, Place())
        west = next((logs / "west").iterdir())
        np.save(west / "database_descriptors.npy", np.eye(8, dtype=np.float32))
        with pytest.raises(UserError, match="descriptors of 8 and 24 dimensions"):
            scored(logs, home)

    def test_no_benchmark(self, tmp_path: Path, log: Path, one: Path) -> None:
        (one / "made" / "scenes" / "east" / "queries.csv").unlink()
        with pytest.raises(UserError):
            scored(log, one)

    @pytest.mark.parametrize("cut", [0, 5, 60, 128, 200])
    def test_cut_files(self, one: Path, log: Path, cut: int) -> None:
        file = log / "database_descriptors.npy"
        file.write_bytes(file.read_bytes()[:cut])
        with pytest.raises(UserError, match="no array of floating-point numbers"):
            scored(log, one)

    def test_pickles_are_not_loaded(self, one: Path, log: Path) -> None:
        np.save(log / "database_descriptors.npy", np.array([{}], dtype=object))
        with pytest.raises(UserError, match="pickled Python objects, never loaded"):
            scored(log, one)


def test_rows_of_several_arrays() -> None:
    whole = np.arange(24.0).reshape(8, 3)
    parts = RowParts((whole[:3], whole[3:4], whole[4:]))
    assert parts.shape == (8, 3)
    assert np.array_equal(parts[2:7], whole[2:7])
    assert np.array_equal(parts[np.array([7, 0, 3])], whole[[7, 0, 3]])
    found = parts.whole(5, 3)
    assert found is not None
    assert np.array_equal(found[0][found[1] :], whole[5:])
    assert parts.whole(2, 2) is None
