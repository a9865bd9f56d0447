"""`prepare --add-to`: scenes that join a folder, and those that may not."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.protocol.lookup import load_protocol
from tests.datasets.native.flights import Flights, everything, mark_photos, prepare
from tests.support import make_place, run_main


def test_a_scene_is_added_to_a_folder(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prepare(source, "--scene", "one", "--copy") == 0
    folder = data / "flights-partial"
    before = everything(folder / "scenes")
    capsys.readouterr()
    assert prepare(source, "--scene", "two", "--add-to", folder, "--copy") == 0
    opened = Benchmark.open(folder)
    assert [scene.id for scene in opened.file.scenes] == ["one", "two"]
    assert before.items() <= everything(folder / "scenes").items()
    assert (folder / "data" / "one" / "dom.tif").is_file()
    (protocol,) = (load_protocol(path) for path in (folder / "protocols").iterdir())
    assert [scene.id for scene in protocol.scenes] == ["one", "two"]
    opened.check_fits(protocol)
    capsys.readouterr()
    assert prepare(source, "--scene", "two", "--add-to", folder) == 2
    assert "has a scene two already" in capsys.readouterr().err
    assert prepare(source, "--scene", "three", "--add-to", folder, "--track", "matching") == 2
    assert "has truth for retrieval" in capsys.readouterr().err
    assert everything(folder)["benchmark.toml"] == (folder / "benchmark.toml").read_bytes()


def test_own_photos_are_added_with_the_same_settings_only(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place, other = make_place(tmp_path / "a"), make_place(tmp_path / "b")
    assert run_main(*place.arguments()) == 0
    add = ("--add-to", data / "park")
    assert run_main(*other.arguments(name="later", tile_size=128), *add) == 2
    assert "gallery.tile_sizes_px" in capsys.readouterr().err
    folder = everything(data / "park")
    assert run_main(*other.arguments(name="later"), *add) == 2  # the same photos again
    assert "4 of 4 photos (first 3: " in (said := capsys.readouterr().err)
    assert "of scene later are photos of scene park" in said
    assert everything(data / "park") == folder
    name = mark_photos(other.images, "later", but=1)
    assert run_main(*other.arguments(name="later"), *add) == 0
    assert f"warning: 1 of 4 photos ({name}) of scene later are" in capsys.readouterr().err
    assert [scene.id for scene in load_benchmark("park").scenes] == ["park", "later"]


def test_a_flight_whose_photos_were_moved_is_known_by_its_poses(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place, other = make_place(tmp_path / "a"), make_place(tmp_path / "b")
    assert run_main(*place.arguments()) == 0
    place.images.rename(tmp_path / "elsewhere")
    assert run_main(*other.arguments(name="later"), "--add-to", data / "park") == 2
    assert "of scene later are photos of scene park" in capsys.readouterr().err
