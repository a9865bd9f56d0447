"""How scores move with assumed values: variants worked by hand, and the noise floors of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import Result as Ran

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.benchmark.queries import cameras_of, poses_of, query_table
from airzoo_bench.core.errors import ResultError, UserError
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rotations import angles_to_rotations, rotations_to_angles
from airzoo_bench.results.records import read_scored
from airzoo_bench.results.sensitivity import Sensitivity, read_noise_floor
from airzoo_bench.retrieval.assumptions import AssumedRanges, Variant, moved_queries
from airzoo_bench.retrieval.sensitivity import sensitivity
from airzoo_bench.retrieval.truth import read_truth
from tests.support import Place, make_place, run_main, write_predictions

# Of photo a, whose anchors lie at y = 31.19 and 96.81: from 5 m lower at 32.75 and 95.25.
NEW_AT_LESS_HEIGHT = (0, 32, 64, 64)
# North-west corners of tiles that hold an anchor of each photo by more than 10 m.
SURE = {
    "park/a": (0, 0),
    "park/b": (128, 0),
    "park/c": (0, 128),
    "park/sub/d": (128, 128),
}


def window_ids(data: Path) -> dict[tuple[int, ...], str]:
    truth = read_truth(data / "park" / "scenes" / "park", "park")
    windows = truth.tiles[["x", "y", "width", "height"]].to_numpy().tolist()
    return {tuple(w): tile for w, tile in zip(windows, truth.tiles["id"], strict=True)}


def predictions(data: Path, first: dict[str, str]) -> dict[str, list[Any]]:
    """Rank a tile first that answers from any height near by, but where told otherwise."""
    tiles = window_ids(data)
    best = {query: tiles[(*corner, 64, 64)] for query, corner in SURE.items()} | first
    ranked = [[tile, *[t for t in tiles.values() if t != tile][:9]] for tile in best.values()]
    return {"query_ids": list(best), "ranked_ids": ranked}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return make_place(tmp_path / "sources")


@pytest.fixture
def results(tmp_path: Path, place: Place, capsys: pytest.CaptureFixture[str]) -> list[Path]:
    """Two methods that differ by a photo, whose tile answers from 5 m lower."""
    data = tmp_path / "data"
    assert run_main(*place.arguments()) == 0
    new = window_ids(data)[NEW_AT_LESS_HEIGHT]
    for name, first in {"sure": {}, "doubtful": {"park/a": new}}.items():
        file = write_predictions(
            tmp_path / f"{name}.npz", "park-retrieval", **predictions(data, first)
        )
        assert run_main("eval", "retrieval", file, "--out", tmp_path / name) == 0
    capsys.readouterr()
    return [tmp_path / "sure", tmp_path / "doubtful"]


def moved(results: list[Path], ranges: AssumedRanges, draws: int = 3) -> Sensitivity:
    from airzoo_bench.protocol.lookup import find_protocol

    data = results[0].parent / "data"
    protocol = find_protocol("park-retrieval", data)
    methods = read_scored(results)
    return sensitivity(
        find_benchmark("park", data),
        protocol,  # type: ignore[arg-type]
        methods,
        ranges,
        draws=draws,
        seed=0,
    )


def test_a_tile_that_answers_at_another_height_worked_by_hand(results: list[Path]) -> None:
    found = moved(results, AssumedRanges(height_m=5.0))
    assert found.groups == ("height_m", "height_m")
    assert found.overall_base[:, 0].tolist() == [1.0, 0.75]
    assert found.overall[:, :, 0].tolist() == [[1.0, 1.0], [1.0, 0.75]]
    assert found.floors()[0] == 0.25
    here, best, worst = (ranks[:, 0].tolist() for ranks in found.ranks())
    assert (here, best, worst) == ([1, 2], [1, 1], [1, 2])


def test_what_was_scored_is_the_base(results: list[Path]) -> None:
    found = moved(results, AssumedRanges(heading_deg=1.0))
    for row, method in enumerate(read_scored(results)):
        values = [method.result.overall[score.key] for score in found.scores]
        np.testing.assert_allclose(found.overall_base[row], values, rtol=0, atol=1e-15)
    assert [score.title for score in found.scores] == ["R@1", "R@3", "R@5", "AP@5"]


def test_results_of_an_earlier_truth_are_refused(results: list[Path], place: Place) -> None:
    """Its queries and tiles have the names of this one's, and other answers."""
    assert run_main(*place.arguments(), "--plane-height", 3, "--force") == 0
    with pytest.raises(ResultError, match="sure was scored on another truth than this folder's"):
        moved(results, AssumedRanges(height_m=5.0))


def test_values_move_by_themselves_and_together(results: list[Path]) -> None:
    found = moved(results, AssumedRanges(0.1, 5.0, 5.0, 3.0))
    ends = ["field_of_view", "heading_deg", "height_m"]
    assert list(found.groups) == [
        *[name for name in ends for _ in range(2)],
        *["position_m"] * 3,
        *["together"] * 3,
    ]


def test_floors_do_not_depend_on_the_order_of_methods(results: list[Path]) -> None:
    ranges = AssumedRanges(0.1, 5.0, 5.0, 3.0)
    one, other = moved(results, ranges), moved(results[::-1], ranges)
    assert one.floors().tolist() == other.floors().tolist()


def test_queries_that_no_tile_answers_any_more_are_counted(results: list[Path]) -> None:
    found = moved(results, AssumedRanges(position_m=10_000.0))
    assert (found.unanswerable > 0).any()
    assert np.isfinite(found.values).all()


def queries() -> Any:
    rotation = angles_to_rotations([30.0, 170.0], [-60.0, -89.0], [0.0, 5.0], convergence_deg=0.0)
    cameras = Cameras.from_matrices([[[90, 0, 50], [0, 80, 30], [0, 0, 1]]] * 2, 100, 60)
    poses = Poses(rotation=rotation, centres=np.array([[10.0, 20, 30], [40, 50, 60]]))
    return query_table(["s/a", "s/b"], ["a.jpg", "b.jpg"], cameras, poses, None)


def test_headings_turn_clockwise() -> None:
    table = moved_queries(queries(), Variant("heading_deg", AssumedRanges(heading_deg=7.0)), 0)
    angles = rotations_to_angles(poses_of(table).rotation, convergence_deg=0.0)
    np.testing.assert_allclose(angles, [[37, -60, 0], [177, -89, 5]], atol=1e-6)
    assert poses_of(table).centres.tolist() == poses_of(queries()).centres.tolist()


def test_a_field_of_view_grows_by_its_share_across_and_along() -> None:
    table = moved_queries(queries(), Variant("field_of_view", AssumedRanges(field_of_view=0.1)), 0)
    before, after = (
        2 * np.arctan(np.array([100, 60]) / 2 / cameras_of(one).focal) for one in (queries(), table)
    )
    np.testing.assert_allclose(after, 1.1 * before, rtol=1e-12)


def test_positions_are_drawn_by_seed_and_draw() -> None:
    by = AssumedRanges(position_m=2.0)
    draws = [
        poses_of(moved_queries(queries(), Variant("position_m", by, draw), seed)).centres
        for draw, seed in ((0, 0), (0, 0), (1, 0), (0, 1))
    ]
    assert draws[0].tolist() == draws[1].tolist()
    assert len({tuple(one.ravel().tolist()) for one in draws}) == 3
    assert draws[0][:, 2].tolist() == [30.0, 60.0]


def test_a_difference_in_noise_is_no_finding(
    results: list[Path], command: Callable[..., Ran]
) -> None:
    floor = results[0].parent / "floor.json"
    ran = command("sensitivity", "park", *results, "--height", 5, "--out", floor)
    assert ran.exit_code == 0, ran.output
    assert "75.00 to 100.00" in ran.stdout
    assert "noise floor: R@1 25.00 points" in ran.stdout
    first = floor.read_bytes()
    command("sensitivity", "park", *results, "--height", 5, "--out", floor)
    assert floor.read_bytes() == first
    assert read_noise_floor(floor).of("recall@1", "park") == 0.25
    shown = command("table", *results, "--noise-floor", floor, "-f", "latex").stdout
    assert "noise floor: R@1 25.00 points" in shown
    compared = command("compare", *results, "--noise-floor", floor)
    assert compared.exit_code == 0
    assert "noise floor: R@1 25.00 points" in compared.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "nothing is assumed to be off"),
        (["--heading", "5", "--out", "one.json"], "noise floors are of differences"),
    ],
)
def test_refusals(
    results: list[Path],
    arguments: list[str],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = results[:1] if "--out" in arguments else results
    assert run_main("sensitivity", "park", *given, *arguments) == 2
    assert words in capsys.readouterr().err


def test_floors_of_another_truth_are_refused(results: list[Path]) -> None:
    floor = results[0].parent / "floor.json"
    assert run_main("sensitivity", "park", *results, "--height", 5, "--out", floor) == 0
    changed = json.loads(floor.read_text()) | {"truth_fingerprint": "0" * 64}
    floor.write_text(json.dumps(changed))
    found = read_noise_floor(floor)
    with pytest.raises(ResultError, match="another protocol or truth"):
        found.check_fits({one.name: one.result for one in read_scored(results)}, floor)
    floor.write_text("{}")
    with pytest.raises(ResultError, match="no noise floors"):
        read_noise_floor(floor)


def test_floors_of_other_methods_are_refused(
    results: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    floor, third = results[0].parent / "floor.json", results[0].parent / "third"
    assert run_main("sensitivity", "park", *results, "--height", 5, "--out", floor) == 0
    predicted = results[0].parent / "third.npz"
    assert run_main("template", "park-retrieval", "--seed", 5, "--out", predicted) == 0
    assert run_main("eval", "retrieval", predicted, "--out", third) == 0
    capsys.readouterr()
    for command in ("compare", "table"):
        assert run_main(command, *results, third, "--noise-floor", floor) == 2
        said = capsys.readouterr().err
        assert "differences between sure, doubtful, not of 1 of 3 (third)" in said
        assert run_main(command, *results, "--noise-floor", floor) == 0
        capsys.readouterr()


def test_a_truth_on_a_surface_model_is_refused(
    tmp_path: Path, place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main(*place.arguments(rule="dsm")) == 0
    file = write_predictions(
        tmp_path / "p.npz", "park-retrieval", **predictions(tmp_path / "data", {})
    )
    assert run_main("eval", "retrieval", file, "--out", tmp_path / "p") == 0
    assert run_main("sensitivity", "park", tmp_path / "p", "--heading", 3) == 2
    assert "made by the rule 'dsm'" in capsys.readouterr().err


def test_a_changed_folder_is_refused(results: list[Path]) -> None:
    data = results[0].parent / "data"
    tables = data / "park" / "scenes" / "park" / "queries.csv"
    tables.write_text(tables.read_text().replace("64.0,64.0", "60.0,60.0"))
    with pytest.raises(UserError, match="changed since it was prepared"):
        moved(results, AssumedRanges(height_m=1.0))


def test_one_result_has_no_ranks(results: list[Path], command: Callable[..., Ran]) -> None:
    alone = command("sensitivity", "park", results[0], "--height", 5).stdout
    assert "Rank" not in alone
    assert "Worst" not in alone
    assert "no noise floor" in alone
    assert "Worst" in command("sensitivity", "park", *results, "--height", 5).stdout
