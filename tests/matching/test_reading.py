"""What a prediction file of the matching track may hold, and what a bad one gets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.precision import was_rounded_to
from airzoo_bench.matching.predictions import Correspondences, GivenPoses, validation_errors
from airzoo_bench.matching.reading import read_matching
from tests.matching.world import without
from tests.matching.written import (
    CENTRES,
    FAULTY,
    IDS,
    LIMIT,
    MATCHES,
    PAIRS,
    POINTS,
    POSES,
    RT,
    TRUE,
    UNREADABLE,
    written,
)
from tests.support import run_main


def test_matches_are_read_as_they_are(tmp_path: Path) -> None:
    size = np.array([[64, 48], [32, 24]])
    read = read_matching(written(tmp_path / "m.npz", MATCHES | {"image_size": size}), LIMIT)
    content = read.content
    assert isinstance(content, Correspondences)
    assert (read.content.kind, read.protocol, read.query_ids.tolist()) == (
        "matches",
        "photos-matching",
        IDS,
    )
    assert content.map_frame is None
    assert content.points3d is None
    np.testing.assert_array_equal(content.offsets, MATCHES["offsets"])
    np.testing.assert_array_equal(content.query_xy, MATCHES["query_xy"])
    np.testing.assert_array_equal(content.map_xy, MATCHES["map_xy"])
    np.testing.assert_array_equal(content.image_size, size)
    assert list(validation_errors(read)) == []


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_pixels_of_any_precision_become_float64(tmp_path: Path, kind: Any) -> None:
    fields = MATCHES | {"query_xy": MATCHES["query_xy"].astype(kind), "map_frame": "crop"}
    content = read_matching(written(tmp_path / "m.npz", fields), LIMIT).content
    assert isinstance(content, Correspondences)
    assert content.query_xy.dtype == np.float64
    assert content.map_frame == "crop"


@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"])
def test_whole_pixels_of_any_width(tmp_path: Path, kind: str) -> None:
    fields = MATCHES | {"query_xy": np.full((5, 2), 7, kind), "map_xy": np.full((5, 2), 9, kind)}
    content = read_matching(written(tmp_path / "m.npz", fields), LIMIT).content
    assert isinstance(content, Correspondences)
    assert content.query_xy.tolist() == [[7.0, 7.0]] * 5


def test_pairs_are_read_to_the_last_bit(tmp_path: Path) -> None:
    read = read_matching(written(tmp_path / "p.npz", PAIRS), LIMIT)
    assert isinstance(read.content, Correspondences)
    assert read.content.kind == "pairs"
    assert read.content.map_xy is None
    np.testing.assert_array_equal(read.content.points3d, POINTS)


def test_poses_are_world_to_camera_and_nan_is_none(tmp_path: Path) -> None:
    values = RT.copy()
    values[1] = np.nan
    read = read_matching(written(tmp_path / "o.npz", POSES | {"poses": values}), LIMIT)
    assert isinstance(read.content, GivenPoses)
    assert read.content.kind == "poses"
    assert read.content.found.tolist() == [True, False]
    np.testing.assert_allclose(read.content.poses.centres[0], CENTRES[0], rtol=0, atol=1e-8)


def test_queries_without_any_match_are_predictions_too(tmp_path: Path) -> None:
    fields = MATCHES | {
        "offsets": np.zeros(3, np.int64),
        "query_xy": np.zeros((0, 2)),
        "map_xy": np.zeros((0, 2)),
    }
    assert list(validation_errors(read_matching(written(tmp_path / "m.npz", fields), LIMIT))) == []


@pytest.mark.parametrize("case", [name for name in UNREADABLE if name != "infinite"])
def test_unreadable(tmp_path: Path, case: str) -> None:
    fields, fragments = UNREADABLE[case]
    path = written(tmp_path / "bad.npz", fields)
    with pytest.raises(PredictionError) as caught:
        read_matching(path, LIMIT)
    assert str(path) in str(caught.value)
    assert caught.value.expected
    for fragment in fragments:
        assert fragment in str(caught.value)


def test_a_pose_all_infinite_is_none(tmp_path: Path) -> None:
    content = read_matching(written(tmp_path / "o.npz", UNREADABLE["infinite"][0]), LIMIT).content
    assert isinstance(content, GivenPoses)
    assert not content.found.any()


@pytest.mark.parametrize("case", FAULTY)
def test_faulty(tmp_path: Path, case: str) -> None:
    fields, fragments = FAULTY[case]
    found = list(validation_errors(read_matching(written(tmp_path / "bad.npz", fields), LIMIT)))
    assert len(found) == 1
    assert found[0].where is not None
    assert "bad.npz, field" in found[0].where
    assert found[0].expected
    for fragment in fragments:
        assert fragment in str(found[0])


def test_all_faults_are_found_at_once(tmp_path: Path) -> None:
    fields = MATCHES | {
        "query_ids": np.zeros(0, "U8"),
        "offsets": np.zeros(1, np.int64),
        "query_xy": np.full((5, 2), np.nan),
    }
    found = list(validation_errors(read_matching(written(tmp_path / "bad.npz", fields), LIMIT)))
    assert ["holds no id" in f.what for f in found] == [True, False, False]
    assert "do not add up" in found[1].what
    assert "5 rows are NaN" in found[2].what


@pytest.mark.parametrize("field", ["points3d", "centres"])
def test_heights_of_a_float32_model_over_pixels_of_a_map_have_lost_nothing(
    tmp_path: Path, field: str
) -> None:
    count = 200
    row, column = np.divmod(np.arange(count), 20)
    heights = np.random.default_rng(0).uniform(20, 300, count).astype(np.float32)
    # The centres of a map's pixels of half a metre: float32 holds them.
    places = np.column_stack([500_000.25 + column / 2, 1_200_000 - 0.25 - row / 2, heights])
    assert was_rounded_to(places, np.float32)
    ids = np.array([f"hills/q{n}" for n in range(count)])
    fields: dict[str, Any] = {"query_ids": ids, field: places}
    if field == "points3d":
        fields |= {"offsets": np.arange(count + 1), "query_xy": np.ones((count, 2))}
    else:
        fields["rotations"] = np.tile(TRUE.rotation[:1], (count, 1, 1))
    read = read_matching(written(tmp_path / "m.npz", fields), LIMIT)
    assert len(read.query_ids) == count


def test_objects_are_never_unpickled(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> Any:
            return (tmp_path.joinpath("exploded").mkdir, ())

    path = tmp_path / "bad.npz"
    np.savez(path, allow_pickle=True, **MATCHES | {"map_xy": np.array([Bomb()], object)})
    with pytest.raises(PredictionError):
        read_matching(path, LIMIT)
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize("name", ["empty.npz", "empty.txt", "folder.npz", "m.mat", "absent.npz"])
def test_no_prediction_file(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name.startswith("folder"):
        path.mkdir()
    elif not name.startswith("absent"):
        path.touch()
    with pytest.raises(PredictionError, match=name):
        read_matching(path, LIMIT)


def test_too_large_for_the_memory(tmp_path: Path) -> None:
    with pytest.raises(PredictionError, match="query_xy"):
        read_matching(written(tmp_path / "m.npz", MATCHES), 350)


@pytest.mark.parametrize(
    ("fields", "code", "message"),
    [
        (UNREADABLE["two kinds"][0], 1, "holds map_xy and points3d"),
        (UNREADABLE["nan in part"][0], 1, "NaN or infinite in part"),
        (UNREADABLE["scaled"][0], 1, "not orthonormal"),
        (UNREADABLE["coarse points"][0], 1, "float32"),
        (without(MATCHES, "protocol"), 2, "--protocol"),
        (FAULTY["nan"][0], 1, "1 row is NaN or infinite, in 1 of 2 queries (hills/b)"),
        (FAULTY["offsets short"][0], 1, "do not add up"),
    ],
)
def test_the_command_says_so(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    fields: dict[str, Any],
    code: int,
    message: str,
) -> None:
    path = written(tmp_path / "bad.npz", fields)
    ask = ("--data", tmp_path)
    assert run_main("eval", "matching", path, *ask) == 2
    assert message in capsys.readouterr().err
    if "protocol" in fields:  # without it the track is not known
        assert run_main("check", path, *ask) == code
        assert message in capsys.readouterr().err
