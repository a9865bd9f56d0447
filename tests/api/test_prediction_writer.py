"""A prediction writer writes what `eval` scores, and refuses at once what it could not score."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.api.benchmark import BlindBenchmark, load_benchmark
from airzoo_bench.api.writer import PredictionWriter
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.files import sha256_of, sha256_of_tree
from tests.api.place import MATCHING, NAME, RECONSTRUCTION, RETRIEVAL, TILES, A, B
from tests.api.scored import scored
from tests.matching import world as matching_world
from tests.reconstruction import world as reconstruction_world
from tests.support import MadeScene, files_below

XY = np.array([[10.0, 20.0], [30.0, 40.0]])
TURN = np.diag((1.0, -1.0, -1.0))
CENTRE = np.array((500_100.0, 5_199_900.0, 190.0))
K = np.array([[32.0, 0, 16], [0, 32.0, 12], [0, 0, 1]])
VIEW = {"rotation": TURN, "centre": CENTRE, "intrinsics": K, "depth": np.ones((24, 32))}


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


XYS = {"query_xy": XY, "map_xy": XY}
MASKED = np.ma.masked_equal([1.0, 2], 2)


@pytest.fixture(scope="module")
def writers(prepared: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return a writer of each protocol, to which no answer was added."""
    out, benchmark = tmp_path_factory.mktemp("out"), load_benchmark(prepared / "data" / NAME)
    names = {RETRIEVAL: "a.npz", MATCHING: "b.npz", RECONSTRUCTION: "c"}
    return {key: PredictionWriter(out / name, key, benchmark) for key, name in names.items()}


@pytest.mark.parametrize(
    ("protocol", "name", "fields", "named"),
    [
        (RETRIEVAL, f"{NAME}/aa", {"ranked_ids": TILES}, "did you mean"),
        (RETRIEVAL, f"{A}.png", {"ranked_ids": TILES}, "'field/a'"),
        (RETRIEVAL, A, {"ranked_ids": ["field/9"]}, "field/9"),
        (RETRIEVAL, A, {"ranks": TILES}, "ranked_ids and scores"),
        (RETRIEVAL, A, {}, "ranked_ids and scores"),
        (RETRIEVAL, A, XYS, "ranked_ids and scores"),
        (RETRIEVAL, A, {"ranked_ids": TILES, "scores": [1, 2]}, "ranked_ids, scores"),
        (RETRIEVAL, TILES[0], {"descriptor": np.ones((2, 2))}, "descriptor"),
        (RETRIEVAL, TILES[0], {"descriptor": [1, 2]}, "descriptor is int64"),
        (RETRIEVAL, A, {"descriptor": MASKED}, "descriptor"),
        (MATCHING, f"{NAME}/x", XYS, "field/x"),
        (MATCHING, A, XYS | {"map_xy": XY[:1]}, "query_xy, map_xy"),
        (MATCHING, A, XYS | {"map_xy": XY * np.nan}, "map_xy"),
        (MATCHING, A, {"query_xy": XY}, "query_xy"),
        (MATCHING, A, {"rotation": TURN * 2, "centre": CENTRE}, "rotation"),
        (MATCHING, A, {"rotation": TURN, "centre": CENTRE.astype("f4")}, "centre"),
        (RECONSTRUCTION, A, {"points": XY}, "field"),
        (RECONSTRUCTION, NAME, {"points": XY}, "points"),
        (RECONSTRUCTION, NAME, {"points": np.full((3, 3), np.nan)}, "points"),
        (RECONSTRUCTION, f"{NAME}/x", VIEW, "photo of field"),
        (RECONSTRUCTION, A, VIEW | {"depth": np.ones((2, 24, 32))}, "depth"),
        (RECONSTRUCTION, A, VIEW | {"confidence": np.ones((2, 2))}, "confidence"),
    ],
)
def test_an_answer_that_cannot_be_meant_is_refused_at_once(
    writers: dict[str, Any], protocol: str, name: str, fields: dict[str, Any], named: str
) -> None:
    writer = writers[protocol]
    with pytest.raises(UserError) as refusal:
        writer.add(name, **fields)
    assert re.match(rf".*/(a\.npz|b\.npz|c), {re.escape(name)}", str(refusal.value))
    assert named in str(refusal.value)
    assert len(writer) == 0


@pytest.mark.parametrize(
    ("protocol", "first", "second", "named"),
    [
        (RETRIEVAL, {"ranked_ids": TILES}, {"descriptor": [1.0]}, "ranked_ids"),
        (RETRIEVAL, {"ranked_ids": TILES}, {"ranked_ids": TILES, "scores": [*range(6)]}, "scores"),
        (RETRIEVAL, {"descriptor": [1.0, 2]}, {"descriptor": [1.0]}, "descriptor"),
        (RECONSTRUCTION, VIEW, VIEW | {"depth": np.ones((25, 32))}, "depth"),
        (RECONSTRUCTION, VIEW, {"rotation": TURN, "centre": CENTRE}, "depth"),
    ],
)
def test_answers_that_do_not_go_together(
    root: Path,
    field: BlindBenchmark,
    tmp_path: Path,
    protocol: str,
    first: dict[str, Any],
    second: dict[str, Any],
    named: str,
) -> None:
    writer = PredictionWriter(tmp_path / "mine.npz", protocol, field)
    writer.add(A, **first)
    with pytest.raises(UserError, match="added before"):
        writer.add(A, **first)
    with pytest.raises(UserError, match=named):
        writer.add(B, **second)
    assert len(writer) == 1


def test_what_eval_would_refuse_is_said_at_the_end(
    root: Path, field: BlindBenchmark, tmp_path: Path
) -> None:
    for fields in ({"ranked_ids": TILES[:3], "scores": [1, 3, 2]}, {"ranked_ids": TILES[:1] * 2}):
        writer = PredictionWriter(tmp_path / "mine.npz", RETRIEVAL, field)
        writer.add(A, **fields)
        with pytest.raises(UserError):
            writer.close()
        assert files_below(tmp_path) == {"mine.npz"}, "the answers are not lost"
    both = PredictionWriter(tmp_path / "mine", RECONSTRUCTION, field)
    both.add(A, **VIEW)
    both.add(NAME, points=np.ones((3, 3)))
    with pytest.raises(UserError, match=r"field\.(npz|ply)"):
        both.close()


@pytest.mark.parametrize(
    ("track", "error"),
    [
        ("retrieval", KeyboardInterrupt),
        ("matching", RuntimeError),
        ("reconstruction", RuntimeError),
    ],
)
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
                xy, crop = np.full((5, 2), 7.0 + stopped), scene.crops()[0]
                writer.add(crop.query.id, query_xy=xy, map_xy=crop.to_map(xy))
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


def test_an_array_that_is_used_again_is_not_changed_in_the_file(
    root: Path, field: BlindBenchmark, tmp_path: Path
) -> None:
    row = np.ones(2, np.float32)
    with PredictionWriter(tmp_path / "mine.npz", RETRIEVAL, field) as writer:
        for number, name in enumerate((A, *(t.id for t in field.scenes[0].tiles()))):
            row[1] = number + 1
            writer.add(name, descriptor=row)
    with np.load(tmp_path / "mine.npz") as file:
        assert file["query_descriptors"].tolist() == [[1.0, 1.0]]
        assert file["gallery_descriptors"][:3, 1].tolist() == [2.0, 3.0, 4.0]


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
