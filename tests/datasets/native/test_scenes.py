"""Which scenes `prepare` takes of a benchmark as downloaded: all, some, those that are sound."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.protocol.lookup import load_protocol
from tests.datasets.native.flights import SCENES, Flights, prepare
from tests.support import run_main


def test_all_scenes_with_what_it_says_of_itself(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prepare(source) == 0
    said = capsys.readouterr()
    assert said.out.splitlines()[:3] == [
        str(data / "flights"),
        "  licence: CC BY 4.0",
        "  assumed: North is up.",
    ]
    assert "published" not in said.err
    assert said.err.count("its heading is assumed") == 3
    benchmark = load_benchmark("flights")
    assert [scene.title for scene in benchmark.scenes] == [f"Flight {one}" for one in SCENES]
    photo = benchmark.scene("two").queries()[0]
    assert photo.conditions["weather"] == "fog"
    assert {path.name for path in data.iterdir()} == {"flights"}


def test_counts_that_are_not_the_published_ones_are_told(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prepare(source, "--published", 6, "--scene", "two") == 0
    said = capsys.readouterr().err
    assert (
        "warning: scene two has 4 of 6 queries that are published for flights-retrieval "
        "(2 missing); 4 photos have a pose" in said
    )


def test_some_scenes_are_a_benchmark_of_another_name(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prepare(source, "--scene", "three", "--scene", "one") == 0
    said = capsys.readouterr().err
    assert "2 of 3 scenes, without two: the benchmark is named flights-partial" in said
    made = load_benchmark("flights-partial")
    assert [scene.id for scene in made.scenes] == ["one", "three"]
    (protocol,) = (load_protocol(path) for path in (made.folder / "protocols").iterdir())
    assert protocol.name == "flights-retrieval-partial"
    assert [scene.id for scene in protocol.scenes] == ["one", "three"]
    assert prepare(source, "--scene", "four") == 2
    assert "one, two, three" in capsys.readouterr().err


def test_scenes_that_are_not_downloaded_make_it_partial(
    flights: Flights, source: Path, data: Path
) -> None:
    shutil.rmtree(source / "two")
    assert prepare(source) == 0
    assert [path.name for path in data.iterdir()] == ["flights-partial"]


def test_a_broken_scene_stops_or_is_left_out(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (source / "two" / "broken").touch()
    assert prepare(source) == 2
    said = capsys.readouterr().err
    assert "half a download" in said
    assert "1 finished scene of 3 is kept" in said
    assert not (data / "flights").exists()
    assert prepare(source, "--keep-going") == 1
    said = capsys.readouterr().err
    assert flights.read_scenes == ["one", "two", "two", "three"]
    assert "left out, scene two: " in said
    assert "half a download" in said
    assert [path.name for path in data.iterdir()] == ["flights-partial"]
    # Mended, the two others are not made again.
    (source / "two" / "broken").unlink()
    assert prepare(source) == 0
    assert flights.read_scenes == ["one", "two", "two", "three", "two"]
    assert {path.name for path in data.iterdir()} == {"flights", "flights-partial"}


def test_no_scene_at_all_makes_no_folder(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for scene in SCENES:
        (source / scene / "broken").touch()
    assert prepare(source, "--keep-going") == 2
    assert capsys.readouterr().err.count("half a download") == 3
    assert not data.exists() or not list(data.iterdir())


def test_protocols_say_where_the_data_are(
    flights: Flights,
    source: Path,
    data: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert prepare(source, "--scene", "one") == 0
    capsys.readouterr()
    monkeypatch.setenv("COLUMNS", "80")
    assert run_main("protocols") == 0
    listed = capsys.readouterr().out
    assert max(map(len, listed.splitlines())) <= 80
    assert "flights-retrieval-partial" in listed
    assert run_main("protocols", "--format", "json") == 0
    said = capsys.readouterr().out
    for text in ("https://example.org", "CC BY 4.0", "North is up.", "flights-retrieval-partial"):
        assert text in said
    assert run_main("protocols", "flights-retrieval-partial") == 0
    text = capsys.readouterr().out
    assert text.startswith("# Flights: https://example.org\n# licence: CC BY 4.0\n# assumed: North")
    again = data / "again.toml"
    again.write_text(text)
    assert load_protocol(again).benchmark == "flights-partial"


def test_a_failed_run_leaves_no_data_root(flights: Flights, source: Path, tmp_path: Path) -> None:
    (source / "one" / "broken").touch()
    assert prepare(source, "--out", tmp_path / "a" / "b" / "made") == 2
    assert not (tmp_path / "a").exists()


def test_notes_name_their_scene_where_there_are_several(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prepare(source) == 0
    assert "scene two: its heading is assumed" in capsys.readouterr().err
    assert prepare(source, "--scene", "two", "--out", data / "alone") == 0
    assert "\nits heading is assumed" in "\n" + capsys.readouterr().err


def test_an_error_of_one_scene_tells_how_to_go_on_without(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (source / "two" / "broken").touch()
    assert prepare(source) == 2
    assert "--keep-going, or name those to make with --scene" in capsys.readouterr().err
    assert prepare(source, "--scene", "two") == 2
    assert "--keep-going" not in capsys.readouterr().err
