from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.api.benchmark import BlindBenchmark, load_benchmark
from airzoo_bench.api.prediction_writer import PredictionWriter
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.files import sha256_of, sha256_of_tree
from tests.api.place import NAME, RETRIEVAL, TILES, A, B
from tests.api.scored import scored
from tests.matching import world as matching_world
from tests.reconstruction import world as reconstruction_world
from tests.support import MadeScene, files_below


def ranked(scene: MadeScene, number: int) -> list[str]:
    """Return the tiles that answer a query, and then others."""
    rest = [t for t in range(scene.n_tiles) if t not in scene.positives[number]]
    return [scene.tile(t) for t in [*scene.positives[number], *rest]]


@pytest.mark.parametrize("way", [None, 1.0, -1.0])
def test_ranked_ids(
    data: Path,
    scenes: list[MadeScene],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    way: float | None,
) -> None:
    path = tmp_path / "mine.npz"
    with PredictionWriter(path, "made-retrieval") as writer:
        for scene in scenes:
            for number in range(len(scene.positives)):
                best = ranked(scene, number)[: 3 + number]
                scores = None if way is None else way * np.arange(len(best))
                writer.add(scene.query(number), ranked_ids=best, scores=scores)
        assert (len(writer), writer.missing()) == (10, ())
    averages = scored("retrieval", path, data, capsys)
    assert [averages[f"R@{k}"] for k in (1, 3, 5)] == ["100.00"] * 3


def test_a_list_may_be_empty_and_holds_tiles_of_its_own_scene(
    data: Path, scenes: list[MadeScene], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    east, west = scenes
    path = tmp_path / "mine.npz"
    with PredictionWriter(path, "made-retrieval") as writer:
        with pytest.raises(UserError, match="tiles of another scene"):
            writer.add(east.query(0), ranked_ids=[east.tile(0), west.tile(0)])
        writer.add(east.query(0), ranked_ids=[])
        for number in range(4):
            writer.add(west.query(number), ranked_ids=np.array(ranked(west, number)))
    assert scored("retrieval", path, data, capsys)["R@1"] == "50.00"


def test_the_order_of_answers_does_not_matter(
    data: Path, scenes: list[MadeScene], tmp_path: Path
) -> None:
    sums = set()
    for way in (1, -1):
        path = tmp_path / f"{way}.npz"
        with PredictionWriter(path, "made-retrieval") as writer:
            for number in range(4)[::way]:
                for scene in scenes[::way]:
                    writer.add(scene.query(number), ranked_ids=ranked(scene, number))
        sums.add(sha256_of(path))
    assert len(sums) == 1
    with np.load(path) as file:
        assert file["query_ids"].tolist() == [s.query(n) for s in scenes for n in range(4)]


def test_descriptors(
    data: Path, scenes: list[MadeScene], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Query q is described as the tile q, its first positive, and lies nearest to it and q + 1."""
    path = tmp_path / "mine.npz"
    with PredictionWriter(path, "made-retrieval", load_benchmark("made")) as writer:
        for scene in scenes:
            for tile in reversed(range(scene.n_tiles)):
                writer.add(scene.tile(tile), descriptor=np.array([tile, 1], np.float32))
            for query in range(len(scene.positives) - 1):
                writer.add(scene.query(query), descriptor=np.array([query + 0.4, 1], np.float32))
        assert writer.missing() == (scenes[0].query(5), scenes[1].query(3))
    with np.load(path) as file:
        assert file["gallery_descriptors"][:, 0].tolist() == [*range(12), *range(8)]
        assert file["query_ids"].tolist()[4:6] == ["east/q00004", "west/q00000"]
        assert file["query_descriptors"].dtype == np.float32
    # The two queries without a descriptor are failures: 5 of 6 and 3 of 4.
    assert scored("retrieval", path, data, capsys)["R@1"] == "79.17"


@pytest.mark.parametrize("kind", ["matches", "pairs", "poses"])
def test_matching(tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str) -> None:
    world = matching_world.make_world(tmp_path)
    path = tmp_path / "mine.npz"
    poses = world.truth.poses
    with PredictionWriter(path, world.protocol.name, load_benchmark(world.folder)) as writer:
        for row in reversed(range(len(world.ids))):
            fields: dict[str, Any] = {"query_xy": world.query_xy[row]}
            if kind == "matches":
                fields["map_xy"] = world.map_xy[row]
            elif kind == "pairs":
                fields["points3d"] = world.points[row]
            else:
                fields = {"rotation": poses.rotation[row], "centre": poses.centres[row]}
            writer.add(world.ids[row], **fields)
    averages = scored("matching", path, world.root, capsys)
    assert (averages["Median"], averages["@1m,1°"]) == ("0.00", "100.00")


def test_a_query_without_matches_is_a_failure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world = matching_world.make_world(tmp_path)
    path = tmp_path / "mine.npz"
    with PredictionWriter(path, world.protocol.name, load_benchmark(world.folder)) as writer:
        writer.add(world.ids[0], query_xy=world.query_xy[0], map_xy=world.map_xy[0])
        writer.add(world.ids[1], query_xy=np.zeros((0, 2)), map_xy=np.zeros((0, 2)))
    assert scored("matching", path, world.root, capsys)["@1m"] == "20.00"


@pytest.mark.parametrize("kind", ["depth", "cloud"])
def test_reconstruction(tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str) -> None:
    world = reconstruction_world.make_world(tmp_path)
    benchmark = load_benchmark(world.folder)
    out = tmp_path / "mine"
    matrix = reconstruction_world.matrix_of_maps()
    with PredictionWriter(out, reconstruction_world.PROTOCOL, benchmark) as writer:
        for scene in benchmark.scenes:
            poses = reconstruction_world.camera_poses(scene.id)
            depth = reconstruction_world.exact_depth(poses, boxed=scene.id == "yard")
            if kind == "cloud":
                writer.add(scene.id, points=reconstruction_world.true_points(scene.id))
            for row, photo in reversed(list(enumerate(scene.photos()))):
                pose = {"rotation": poses.rotation[row], "centre": poses.centres[row]}
                maps = {"depth": depth[row], "intrinsics": matrix} if kind == "depth" else {}
                writer.add(photo.id, **pose, **maps)
        assert writer.missing() == ()
    assert files_below(out) >= {"protocol.txt", f"yard.{'npz' if kind == 'depth' else 'ply'}"}
    averages = scored("reconstruction", out, world.root, capsys)
    assert averages["P@10m"] == "100.00"
    assert float(averages["Accuracy"]) < (0.3 if kind == "depth" else 0.005)


def test_depth_of_some_photos_keeps_its_rows(tmp_path: Path) -> None:
    world = reconstruction_world.make_world(tmp_path)
    benchmark = load_benchmark(world.folder)
    photos = benchmark.scene("yard").photos()
    matrix = reconstruction_world.matrix_of_maps()
    with PredictionWriter(tmp_path / "mine", reconstruction_world.PROTOCOL, benchmark) as writer:
        for row in (4, 1):
            depth = np.full((36, 48), row, np.float32)
            pose = {"rotation": np.eye(3), "centre": np.array((row, 2.0, 3.0))}
            maps = {"depth": depth, "confidence": depth / 10, "intrinsics": matrix}
            writer.add(photos[row].id, **pose, **maps)
    with np.load(tmp_path / "mine" / "yard.npz") as file:
        assert file["image_names"].tolist() == [photos[1].name, photos[4].name]
        assert file["depth"][:, 5, 5].tolist() == [1, 4]
        assert file["conf"][:, 0, 0].tolist() == pytest.approx([0.1, 0.4])
        assert file["extrinsics"][:, :, 3].tolist() == [[-1, -2, -3], [-4, -2, -3]]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
@pytest.mark.parametrize("track", ["retrieval", "matching", "reconstruction"])
def test_an_exception_leaves_what_was_there(
    root: Path, field: BlindBenchmark, tmp_path: Path, error: type[BaseException], track: str
) -> None:
    out = tmp_path / ("mine" if track == "reconstruction" else "mine.npz")
    scene = field.scene(NAME)

    def predict(*, stopped: bool) -> None:
        with PredictionWriter(out, f"{NAME}-{track}", field) as writer:
            if track == "retrieval":
                for tile in scene.tiles():
                    writer.add(tile.id, descriptor=np.full(4, 1 + stopped, np.float32))
                writer.add(scene.queries()[0].id, descriptor=np.ones(4, np.float32))
            elif track == "matching":
                xy = np.full((5, 2), 7.0 + stopped)
                writer.add(scene.crops()[0].query.id, query_xy=xy, map_xy=xy)
            else:
                writer.add(NAME, points=np.ones((4, 3)) + stopped)
            if stopped:
                raise error

    with pytest.raises(error):
        predict(stopped=True)
    assert files_below(tmp_path) == set()
    predict(stopped=False)
    before = sha256_of_tree(out)
    with pytest.raises(error):
        predict(stopped=True)
    assert sha256_of_tree(out) == before
    assert len(list(tmp_path.iterdir())) == 1


def test_a_tile_without_a_descriptor_is_refused_at_the_end(
    root: Path, field: BlindBenchmark, tmp_path: Path
) -> None:
    tiles = field.scene(NAME).tiles()
    writer = PredictionWriter(tmp_path / "mine.npz", RETRIEVAL, field)
    writer.add(A, descriptor=[1.0])
    for tile in (*tiles[:9], *tiles[10:]):
        writer.add(tile.id, descriptor=[2.0])
    with pytest.raises(UserError, match=f"no descriptor of tiles: 1 of 274 .{tiles[9].id}"):
        writer.close()
    assert files_below(tmp_path) == set()


def test_a_second_writer_of_a_file_is_refused_before_any_work(
    root: Path, field: BlindBenchmark, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "mine.npz"
    with PredictionWriter(out, RETRIEVAL, field) as writer:
        writer.add(A, ranked_ids=TILES)
        with pytest.raises(UserError, match="is being written by another PredictionWriter"):
            PredictionWriter("mine.npz", RETRIEVAL, field)
        run = subprocess.run([sys.executable, "-c", OPEN, str(field.folder)], check=False)
        assert run.returncode == 5
        with PredictionWriter("other.npz", RETRIEVAL, field) as other:
            other.add(A, ranked_ids=TILES[:2])
    assert files_below(tmp_path) >= {"mine.npz", "other.npz"}
    assert not list(tmp_path.glob(".*"))
    with PredictionWriter(out, RETRIEVAL, field) as again:
        again.add(A, ranked_ids=TILES)


OPEN = f"""
import sys
import airzoo_bench as ab
try:
    ab.PredictionWriter("mine.npz", "{RETRIEVAL}", ab.load_benchmark(sys.argv[1]))
except ab.UserError as error:
    sys.exit(5 if "is being written" in str(error) else 6)
"""


def test_places_and_protocols(
    root: Path, field: BlindBenchmark, data: Path, tmp_path: Path
) -> None:
    other = data / "made" / "protocols" / "made-retrieval.toml"
    with pytest.raises(UserError, match=r"written as \.npz"):
        PredictionWriter(tmp_path / "mine", RETRIEVAL, field)
    with pytest.raises(UserError, match="is of benchmark made, not field"):
        PredictionWriter(tmp_path / "mine.npz", str(other), field)
    with pytest.raises(UserError, match="unknown protocol"):
        PredictionWriter(tmp_path / "mine.npz", "nothing", field)
    with pytest.raises(UserError, match="no answer was added"):
        PredictionWriter(tmp_path / "mine.npz", RETRIEVAL, field).close()
    writer = PredictionWriter(tmp_path / "mine.npz", RETRIEVAL, field)
    writer.add(A, ranked_ids=TILES)
    writer.close()
    writer.close()
    with pytest.raises(UserError, match="the file is closed"):
        writer.add(B, ranked_ids=TILES)
    assert files_below(tmp_path) & {"mine.npz"}
