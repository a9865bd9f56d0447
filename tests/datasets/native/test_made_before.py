"""`prepare` once more: what is made again, what is kept, and two runs at once."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from airzoo_bench.core.files import only_writer
from tests.datasets.native.flights import NAMES, SCENES, Flights, everything, prepare


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
