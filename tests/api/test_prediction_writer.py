"""A prediction writer writes what `eval` scores, and refuses at once what it could not score."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.api.writer import PredictionWriter
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.files import sha256_of, sha256_of_tree
from tests.api.place import MATCHING, NAME, RECONSTRUCTION, RETRIEVAL, TILES, A, B, scored
from tests.matching import world as matching_world
from tests.reconstruction import world as reconstruction_world
from tests.support import files_below

XY = np.array([[10.0, 20.0], [30.0, 40.0]])
TURN = np.diag((1.0, -1.0, -1.0))
POSE = {"rotation": TURN, "centre": np.array((500_100.0, 5_199_900.0, 190.0))}
K = np.array([[32.0, 0, 16], [0, 32.0, 12], [0, 0, 1]])
VIEW = POSE | {"intrinsics": K, "depth": np.ones((24, 32))}


def test_ranked_ids(data, scenes, tmp_path, capsys) -> None:
    sums = []
    for way, order in ((None, 1), (None, -1), (-1.0, 1)):
        path = tmp_path / f"{len(sums)}.npz"
        with PredictionWriter(path, "made-retrieval") as writer:
            for scene in scenes[::order]:
                for number, found in list(enumerate(scene.positives))[::order]:
                    rest = [tile for tile in range(scene.n_tiles) if tile not in found]
                    best = [scene.tile(tile) for tile in [*found, *rest][: 3 + number]]
                    scores = None if way is None else way * np.arange(len(best))
                    writer.add(scene.query(number), ranked_ids=best, scores=scores)
        sums.append(sha256_of(path))
    assert sums[0] == sums[1] != sums[2], "the order of the answers does not matter"
    for name in ("0.npz", "2.npz"):
        averages = scored("retrieval", tmp_path / name, data, capsys)
        assert [averages[f"R@{k}"] for k in (1, 3, 5)] == ["100.00"] * 3


def test_descriptors(data, scenes, tmp_path, capsys) -> None:
    """Query q is described as the tile q, its first positive, and lies nearest to it and q + 1."""
    path, row = tmp_path / "mine.npz", np.ones(2, np.float32)
    with PredictionWriter(path, "made-retrieval", load_benchmark("made")) as writer:
        for scene in scenes:
            for tile in reversed(range(scene.n_tiles)):
                row[0] = tile  # an array that is used again is not changed in the file
                writer.add(scene.tile(tile), descriptor=row)
            for query in range(len(scene.positives) - 1):
                writer.add(scene.query(query), descriptor=np.array([query + 0.4, 1], np.float32))
    with np.load(path) as file:
        assert file["gallery_descriptors"][:, 0].tolist() == [*range(12), *range(8)]
        assert file["query_ids"].tolist()[4:6] == ["east/q00004", "west/q00000"]
        assert file["query_descriptors"].dtype == np.float32
    # The two queries without a descriptor are failures: 5 of 6 and 3 of 4.
    assert scored("retrieval", path, data, capsys)["R@1"] == "79.17"


def test_matching(tmp_path, capsys) -> None:
    world, path = matching_world.make_world(tmp_path), tmp_path / "mine.npz"
    benchmark, poses = load_benchmark(world.folder), world.truth.poses
    matches = {"query_xy": world.query_xy}
    for kind in (
        matches | {"map_xy": world.map_xy},
        matches | {"points3d": world.points},
        {"rotation": poses.rotation, "centre": poses.centres},
    ):
        with PredictionWriter(path, world.protocol.name, benchmark) as writer:
            for row in reversed(range(len(world.ids))):
                writer.add(world.ids[row], **{key: values[row] for key, values in kind.items()})
        averages = scored("matching", path, world.root, capsys)
        assert (averages["Median"], averages["@1m,1°"]) == ("0.00", "100.00")


def test_reconstruction(tmp_path, capsys) -> None:
    world = reconstruction_world.make_world(tmp_path)
    benchmark, matrix = load_benchmark(world.folder), reconstruction_world.matrix_of_maps()
    for ending, most_m in (("npz", 0.3), ("ply", 0.005)):
        out = tmp_path / ending
        with PredictionWriter(out, reconstruction_world.PROTOCOL, benchmark) as writer:
            for scene in benchmark.scenes:
                poses = reconstruction_world.camera_poses(scene.id)
                depth = reconstruction_world.exact_depth(poses, boxed=scene.id == "yard")
                if ending == "ply":
                    writer.add(scene.id, points=reconstruction_world.true_points(scene.id))
                for row, photo in reversed(list(enumerate(scene.photos()))):
                    pose = {"rotation": poses.rotation[row], "centre": poses.centres[row]}
                    maps = {"depth": depth[row], "intrinsics": matrix} if ending == "npz" else {}
                    writer.add(photo.id, **pose, **maps)
        assert files_below(out) >= {"protocol.txt", f"yard.{ending}"}
        averages = scored("reconstruction", out, world.root, capsys)
        assert averages["P@10m"] == "100.00"
        assert float(averages["Accuracy"]) < most_m


XYS = {"query_xy": XY, "map_xy": XY}
RANKED = {"ranked_ids": TILES}
MASKED = np.ma.masked_equal([1.0, 2], 2)


@pytest.mark.parametrize(
    ("protocol", "name", "fields", "named"),
    [
        (RETRIEVAL, f"{NAME}/aa", RANKED, "field/aa"),
        (RETRIEVAL, A, {"ranked_ids": ["field/9"]}, "field/9"),
        *((RETRIEVAL, A, fields, "ranked_ids (scores)") for fields in ({}, XYS)),
        (RETRIEVAL, A, RANKED | {"scores": [1, 2]}, "ranked_ids, scores"),
        (RETRIEVAL, TILES[0], {"descriptor": np.ones((2, 2))}, "descriptor"),
        (RETRIEVAL, A, {"descriptor": MASKED}, "descriptor"),
        (MATCHING, A, XYS | {"map_xy": XY[:1]}, "query_xy, map_xy"),
        (RECONSTRUCTION, NAME, {"points": XY}, "points"),
        (RECONSTRUCTION, f"{NAME}/x", VIEW, "photo"),
        (RECONSTRUCTION, A, VIEW | {"depth": np.ones((2, 24, 32))}, "depth"),
        # After another answer, with which these do not go together.
        (RETRIEVAL, B, {"descriptor": [1.0]}, "ranked_ids"),
        (RETRIEVAL, B, RANKED | {"scores": [*range(6)]}, "answers before"),
        (RECONSTRUCTION, B, VIEW | {"depth": np.ones((25, 32))}, "answers before"),
        (RECONSTRUCTION, B, POSE, "answers before"),
    ],
)
def test_an_answer_that_cannot_be_meant_is_refused_at_once(
    field, tmp_path, protocol, name, fields, named
) -> None:
    writer = PredictionWriter(tmp_path / "mine.npz", protocol, field)
    if name == B:
        first = {RETRIEVAL: RANKED, RECONSTRUCTION: VIEW}[protocol]
        writer.add(A, **first)
        with pytest.raises(UserError, match="added before"):
            writer.add(A, **first)
    with pytest.raises(UserError) as refusal:
        writer.add(name, **fields)
    assert f", {name}" in str(refusal.value)
    assert named in str(refusal.value)


@pytest.mark.parametrize(
    ("protocol", "fields"),
    [
        (RETRIEVAL, {"ranked_ids": TILES[:3], "scores": [1, 3, 2]}),
        (RETRIEVAL, {"descriptor": [1.0]}),  # of no tile
        (MATCHING, XYS | {"map_xy": XY * np.nan}),
        (MATCHING, POSE | {"centre": POSE["centre"].astype("f4")}),
        (RECONSTRUCTION, VIEW | {"rotation": TURN * 2}),
    ],
)
def test_the_reader_checks_the_file_and_the_answers_are_not_lost(
    field, tmp_path, protocol, fields
) -> None:
    out = tmp_path / ("mine" if protocol == RECONSTRUCTION else "mine.npz")
    writer = PredictionWriter(out, protocol, field)
    writer.add(A, **fields)
    with pytest.raises(UserError):
        writer.close()
    assert out.name in files_below(tmp_path)


def test_an_exception_leaves_what_was_there(field, tmp_path) -> None:
    def predict(given: Any, error: type[BaseException] | None = None) -> None:
        out, protocol, name, fields = given
        with PredictionWriter(out, protocol, field) as writer:
            writer.add(name, **fields)
            if error is not None:
                raise error

    for given in (
        (tmp_path / "mine.npz", RETRIEVAL, A, RANKED),
        (tmp_path / "mine", RECONSTRUCTION, NAME, {"points": np.eye(3)}),
    ):
        before = files_below(tmp_path)
        with pytest.raises(KeyboardInterrupt):
            predict(given, KeyboardInterrupt)
        assert files_below(tmp_path) == before
        predict(given)
        written = sha256_of_tree(given[0])
        with pytest.raises(RuntimeError):
            predict(given, RuntimeError)
        assert sha256_of_tree(given[0]) == written
    assert len(list(tmp_path.iterdir())) == 2


def test_places_and_protocols(field, data, tmp_path) -> None:
    other, out = data / "made" / "protocols" / "made-retrieval.toml", tmp_path / "mine.npz"
    for path, protocol, message in (
        (tmp_path / "mine", RETRIEVAL, r"\.npz"),
        (out, str(other), "lacks the scenes east, west"),
        (out, "nothing", "unknown protocol"),
    ):
        with pytest.raises(UserError, match=message):
            PredictionWriter(path, protocol, field)
    writer = PredictionWriter(out, RETRIEVAL, field)
    writer.add(field.scene(NAME).tiles()[0].id, descriptor=[2.0])
    with pytest.raises(UserError, match="no answer was added"):
        writer.close()
    assert not out.exists()
