"""What `prepare` does for every benchmark as downloaded, with a made-up one of three scenes."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
import rasterio
import rasterio.shutil

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.options import Option
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.core.temporaries import only_writer
from airzoo_bench.datasets.about import About
from airzoo_bench.datasets.facts_lines import fact_lines, plausibility_warnings
from airzoo_bench.datasets.native import NativeDataset, NativeOptions
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.scene_content import scene_content
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.protocol.lookup import load_protocol
from airzoo_bench.protocol.model import ProtocolScene
from tests.support import (
    DOWN,
    NORTH_WEST,
    PLACE_CRS,
    PLACE_PHOTOS,
    make_place,
    photo_protocols,
    run_main,
    write_raster,
)

SCENES = ("one", "two", "three")
NAMES = tuple(PLACE_PHOTOS)


@dataclass(frozen=True)
class FlightOptions(NativeOptions):
    """What differs between the tests."""

    parts: Annotated[str, Option("parts", "Which parts scenes have.")] = "dom dsm"
    published: Annotated[int, Option("published", "Queries of a scene.")] = 4
    track: Annotated[str, Option("track", "Which protocol there is.")] = "retrieval"


class Flights(NativeDataset[FlightOptions]):
    """Three flights; reading them is counted."""

    summary = "Make a benchmark of flights."
    example = "flights --source flights"
    options = FlightOptions
    about = About("Flights", "https://example.org", "CC BY 4.0", assumptions=("North is up.",))

    def __init__(self) -> None:
        self.read_scenes: list[str] = []
        self.stop_at: str | None = None

    def benchmark(self, options: FlightOptions) -> str:
        return "flights"

    def protocols(self, options: FlightOptions, root: Path) -> BenchmarkProtocols:
        made = photo_protocols("flights", (64,))
        scenes = tuple(
            ProtocolScene(id=one, title=f"Flight {one}", queries=options.published)
            for one in SCENES
        )
        every = {of.track: of.model_copy(update={"scenes": scenes}) for of in made.every}
        return BenchmarkProtocols(**{options.track: every[options.track]})  # type: ignore[arg-type]

    def scenes(self, options: FlightOptions) -> list[str]:
        return [one for one in SCENES if (options.source / one).is_dir()]

    def files(self, options: FlightOptions, scene: str) -> list[Path]:
        return [options.source / scene]

    def read(self, options: FlightOptions, scene: str, progress: Progress) -> NativeScene:
        from airzoo_bench.geometry.cameras import Cameras
        from airzoo_bench.geometry.poses import Poses

        self.read_scenes.append(scene)
        if scene == self.stop_at:
            raise KeyboardInterrupt
        home = options.source / scene
        if (home / "broken").is_file():
            raise BenchmarkError("half a download", where=home / "broken")
        matrices = np.array([[[64.0, 0, 32], [0, 64, 24], [0, 0, 1]]] * 4)
        cameras = Cameras.from_matrices(
            matrices, np.full(4, 64), np.full(4, 48), np.zeros((4, 5)), names=NAMES
        )
        x, y = np.array(list(PLACE_PHOTOS.values())).T
        centres = np.stack([NORTH_WEST[0] + x, NORTH_WEST[1] - y, np.full(4, 200.0)], axis=1)
        poses = Poses.from_centres(np.array([DOWN] * 4), centres, NAMES)
        parts = options.parts.split()
        return NativeScene(
            scene,
            home / "photos",
            NAMES,
            cameras,
            poses,
            LOCAL_CRS if "local" in parts else PLACE_CRS,
            dom=home / "dom.tif" if "dom" in parts else None,
            dsm=home / "dsm.tif" if "dsm" in parts else None,
            cloud=home / "cloud.npy" if "cloud" in parts else None,
            plane_height_m=100.0 if "plane" in parts else None,
            conditions={"weather": ("fog", "sun", "sun", "rain")},
            notes=("its heading is assumed",),
        )


@pytest.fixture
def flights() -> Iterator[Flights]:
    dataset = Flights()
    DATASETS.add("flights", dataset)
    yield dataset
    DATASETS.remove("flights")


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """Three flights over the same place, as downloaded."""
    for scene in SCENES:
        mark_photos(make_place(tmp_path / "source" / scene).images, scene)
    return tmp_path / "source"


def mark_photos(images: Path, mark: str, but: int = 0) -> str:
    """Change the photos' bytes, not their pixels; return the name of one that is left aside."""
    photos = sorted(path for path in images.rglob("*") if path.is_file())
    for photo in photos[but:]:
        with photo.open("ab") as stream:
            stream.write(f"{mark} {photo.name}".encode())
    return photos[0].relative_to(images).as_posix()


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def prepare(source: Path, *more: object) -> int:
    return run_main("prepare", "flights", "--source", source, *more)


def everything(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


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


@pytest.mark.parametrize(
    ("parts", "track"),
    [("dom plane", "retrieval"), ("dom dsm", "retrieval"), ("local cloud", "reconstruction")],
)
def test_a_scene_may_lack_parts(
    flights: Flights, source: Path, data: Path, parts: str, track: str
) -> None:
    for scene in SCENES:
        points = np.random.default_rng(0).uniform(-50, 50, (50, 3))
        points += (NORTH_WEST[0] + 128, NORTH_WEST[1] - 128, 100.0)
        np.save(source / scene / "cloud.npy", points)
    assert prepare(source, "--parts", parts, "--track", track) == 0
    scene = load_benchmark("flights").scene("one")
    assert len(scene.queries() if track == "retrieval" else scene.photos()) == 4
    assert scene.crs == (LOCAL_CRS if "local" in parts else PLACE_CRS)
    assert run_main("check-geometry", data / "flights") == (2 if "local" in parts else 0)


def test_the_plane_gives_what_a_level_surface_gives(
    flights: Flights, source: Path, data: Path
) -> None:
    truths = []
    for parts in ("dom dsm", "dom plane"):
        assert prepare(source, "--parts", parts, "--force") == 0
        truths.append(everything(data / "flights" / "scenes"))
    assert truths[0] == truths[1]


@pytest.mark.parametrize(("parts", "track"), [("dom plane", "matching"), ("local", "retrieval")])
def test_a_track_without_what_it_needs_is_refused(
    flights: Flights,
    source: Path,
    data: Path,
    parts: str,
    track: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert prepare(source, "--parts", parts, "--track", track) == 2
    assert "no track that every scene has truth for" in capsys.readouterr().err
    assert not (data / "flights").exists()


def test_records_of_another_kind_are_left_aside(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert prepare(source) == 0
    record = data / "flights" / "prepared.json"
    for text in ("[]", "{", json.dumps({"one": {"key": 3}}), "\0"):
        record.write_text(text)
        assert prepare(source) == 2
        assert "--force" in capsys.readouterr().err


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


def test_tiles_of_so_many_metres(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = make_place(tmp_path / "a")
    assert run_main(*place.arguments(tile_size=None, tile_size_m=64)) == 0
    assert "tiles of 64 m are 64 px of the map" in capsys.readouterr().err
    tracks = Benchmark.open(data / "park").file.tracks
    assert tracks["retrieval"]["gallery"]["tile_sizes_px"] == [64]
    for changes in ({"tile_size_m": 64}, {"tile_size": None, "tile_size_m": 0.1}):
        assert run_main(*place.arguments(**changes), "--force") == 2
        assert "--tile-size-m" in capsys.readouterr().err


def test_own_photos_over_a_plane(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = make_place(tmp_path / "a")
    assert run_main(*place.arguments(dsm=None)) == 2
    assert "--plane-height" in capsys.readouterr().err
    assert run_main(*place.arguments()) == 0
    whole = everything(data / "park" / "scenes" / "park" / "retrieval")
    assert run_main(*place.arguments(dsm=None, plane_height=100), "--force") == 0
    assert "taken as a plane at 100.0 m" in capsys.readouterr().out
    assert everything(data / "park" / "scenes" / "park" / "retrieval") == whole
    assert run_main(*place.arguments(dsm=None, plane_height=100, rule="dsm"), "--force") == 2
    assert "scene park has no surface model" in capsys.readouterr().err


def test_a_surface_model_in_another_crs_is_refused_with_the_command(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = make_place(tmp_path / "a")
    level = np.full((1, 256, 256), 100, np.float32)
    write_raster(place.dsm, level, crs="EPSG:32634")
    assert run_main(*place.arguments()) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert f"gdalwarp -t_srs 'EPSG:32633' -r bilinear '{place.dsm}'" in said


def test_photos_without_poses_and_place(flights: Flights, source: Path) -> None:
    read = flights.read(FlightOptions(source, parts=""), "one", silent)
    nowhere = replace(read, cameras=None, poses=None, crs=None)
    content = scene_content(nowhere, BenchmarkProtocols())
    assert list(content.truths.photos) == ["id", "image", "weather"]
    assert content.facts is not None
    assert fact_lines(content.facts) == ["photos          4"]
    assert plausibility_warnings(content.facts) == []
    assert json.dumps(content.facts.values(), allow_nan=False)


def test_a_local_frame_has_no_map(flights: Flights, source: Path) -> None:
    read = flights.read(FlightOptions(source, parts="dom dsm local"), "one", silent)
    with pytest.raises(BenchmarkError, match="in a local frame, and there is a map"):
        scene_content(read, BenchmarkProtocols())


def test_photos_that_are_missing_are_named(flights: Flights, source: Path) -> None:
    (source / "one" / "photos" / NAMES[1]).unlink()
    read = flights.read(FlightOptions(source), "one", silent)
    with pytest.raises(
        BenchmarkError, match=f"photos of scene one are missing: 1 of 4.*{NAMES[1]}"
    ):
        scene_content(read, BenchmarkProtocols())


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


def test_a_failed_run_leaves_no_data_root(flights: Flights, source: Path, tmp_path: Path) -> None:
    (source / "one" / "broken").touch()
    assert prepare(source, "--out", tmp_path / "a" / "b" / "made") == 2
    assert not (tmp_path / "a").exists()


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


def test_geometry_of_a_local_scene_needs_depth(
    flights: Flights, source: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for scene in SCENES:
        cloud = np.random.default_rng(0).uniform(0, 200, (500, 3)) - (0, 200, 0)
        np.save(source / scene / "cloud.npy", cloud + np.array((*NORTH_WEST, 0)))
    parts = ("--parts", "local cloud", "--track", "reconstruction")
    assert prepare(source, *parts) == 0
    capsys.readouterr()
    assert run_main("check-geometry", "flights") == 2
    said = capsys.readouterr().err
    assert "nothing can be checked of one: their frame is local, and there is no depth" in said
    assert "--depth" in said
    assert "--crs" not in said
