"""`prepare` once more: what is made again, what is kept, and two runs at once."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.shutil

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.temporaries import only_writer
from airzoo_bench.datasets.native_scene import NativeScene
from tests.datasets.native.flights import NAMES, SCENES, FlightOptions, Flights, everything, prepare
from tests.support import make_place, run_main, write_raster


def test_a_stopped_run_goes_on_and_makes_the_same(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prepare(source) == 0
    whole = everything(data / "flights")
    shutil.rmtree(data)
    flights.read_scenes.clear()
    flights.stop_at = "three"
    with pytest.raises(SystemExit) as stopped:
        raise SystemExit(prepare(source))
    assert stopped.value.code == 130
    assert "2 finished scenes of 3 are kept" in capsys.readouterr().err
    assert not (data / "flights").exists()
    flights.stop_at = None
    assert prepare(source) == 0
    assert "scene one: nothing changed" in capsys.readouterr().err
    assert flights.read_scenes == ["one", "two", "three", "three"]
    assert everything(data / "flights") == whole
    assert [path.name for path in data.iterdir()] == ["flights"]


def test_a_complete_folder_is_not_made_again(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prepare(source) == 0
    assert prepare(source) == 0
    assert "nothing to do" in capsys.readouterr().err
    assert flights.read_scenes == [*SCENES]
    # Another option or another file is another benchmark, which must be asked for.
    assert prepare(source, "--parts", "dom plane") == 2
    assert "--force" in capsys.readouterr().err
    photo = source / "two" / "photos" / NAMES[0]
    photo.write_bytes(photo.read_bytes() + b"\0")
    assert prepare(source) == 2
    assert prepare(source, "--force") == 0
    assert flights.read_scenes == [*SCENES, *SCENES]
    # What was changed within is found.
    (data / "flights" / "scenes" / "one" / "queries.csv").write_text("id\n")
    capsys.readouterr()
    assert prepare(source) == 2
    assert "was changed since it was prepared" in capsys.readouterr().err


def test_a_scene_that_was_changed_within_is_not_taken_into_the_whole(
    flights: Flights, source: Path, data: Path
) -> None:
    assert prepare(source) == 0
    whole = everything(data / "flights")
    shutil.rmtree(data / "flights")
    assert prepare(source, "--scene", "one", "--scene", "two") == 0
    table = data / "flights-partial" / "scenes" / "one" / "queries.csv"
    table.write_text(table.read_text().replace("64.0", "65.0"))
    assert prepare(source) == 0
    assert everything(data / "flights") == whole


def test_a_second_run_does_not_take_the_scenes_of_one_that_is_at_work(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    inner: list[int] = []
    read = flights.read

    def with_another(options: FlightOptions, scene: str, progress: Progress) -> NativeScene:
        if scene == "three" and not inner:
            inner.append(prepare(source, "--out", data / "other", "--published", 5))
        return read(options, scene, progress)

    flights.read = with_another  # type: ignore[method-assign]
    assert prepare(source, "--out", data / "one") == 0
    assert inner == [2]
    assert "another run is making this benchmark here" in capsys.readouterr().err
    assert sorted(path.name for path in data.iterdir()) == ["one"]
    Benchmark.open(data / "one")
    assert sorted(path.name for path in (data / "one" / "scenes").iterdir()) == sorted(SCENES)


def test_files_that_go_with_a_map_are_looked_at_too(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = make_place(tmp_path / "source")
    given = [str(one) for one in place.arguments()]
    tiles = tmp_path / "source" / "dom.tif"
    virtual = tmp_path / "source" / "map.vrt"
    with rasterio.open(tiles) as raster:
        profile = {**raster.profile, "driver": "VRT"}
        profile = {key: profile[key] for key in ("driver", "width", "height", "count", "dtype")}
        vrt = rasterio.shutil.copy(raster, virtual, driver="VRT")
    assert vrt is None
    given[given.index("--dom") + 1] = str(virtual)
    assert run_main(*given) == 0
    assert run_main(*given) == 0
    assert "nothing to do" in capsys.readouterr().err
    write_raster(tiles, np.zeros((3, 256, 256), np.uint8))
    assert run_main(*given) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_world_file_is_looked_at_too(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = make_place(tmp_path / "source")
    given = [str(one) for one in place.arguments()]
    picture = tmp_path / "source" / "map.png"
    with rasterio.open(place.dom) as raster:
        rasterio.shutil.copy(raster, picture, driver="PNG", worldfile="YES")
    world = picture.with_suffix(".wld")
    assert world.is_file()
    given[given.index("--dom") + 1] = str(picture)
    assert run_main(*given) == 0
    capsys.readouterr()
    world.write_text(world.read_text().replace("0", "1", 1))
    assert run_main(*given) == 2
    assert "exists already" in capsys.readouterr().err


def test_records_of_another_kind_are_left_aside(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prepare(source) == 0
    record = data / "flights" / "prepared.json"
    for text in ("[]", "{", json.dumps({"one": {"key": 3}}), "\0"):
        record.write_text(text)
        assert prepare(source) == 2
        assert "--force" in capsys.readouterr().err


def test_two_runs_do_not_share_what_they_make(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data.mkdir()
    with only_writer(data / ".flights.prepare"):
        assert prepare(source) == 2
    said = capsys.readouterr().err
    assert "another run is making this benchmark here" in said
    assert "--out" in said
    assert flights.read_scenes == []
    assert prepare(source) == 0


@pytest.mark.parametrize("part", ["photos", "dom.tif", "dsm.tif"])
def test_a_part_that_is_gone_is_noticed(
    flights: Flights, source: Path, data: Path, part: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing that the scene was read from changed, but what its folder refers to was removed."""
    assert prepare(source) == 0
    home = source / "two"
    flights.files = lambda options, scene: []  # type: ignore[method-assign, assignment]
    assert prepare(source, "--force") == 0
    flights.read_scenes.clear()
    assert prepare(source) == 0
    assert flights.read_scenes == []
    (home / part).rename(home / f"{part}.away")
    capsys.readouterr()
    assert prepare(source) == 2  # the folder is there, and is not what was asked for
    assert "--force" in capsys.readouterr().err
    (home / f"{part}.away").rename(home / part)
    assert prepare(source) == 0
