"""The example that users begin with scores as it stands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.reconstruction.world import PROTOCOL, World, make_world
from tests.support import files_below, run_main

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> World:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return make_world(tmp_path / "data")


def test_the_template_names_all_photos_and_scores(
    world: World, tmp_path: Path, capsys: Capture
) -> None:
    out = tmp_path / "preds"
    assert run_main("template", PROTOCOL, "--out", out) == 0
    assert f"airzoo-bench eval reconstruction {out}" in capsys.readouterr().err
    assert files_below(out) == {"protocol.txt", "yard.npz", "lot.npz"}
    with np.load(out / "yard.npz") as arrays:
        assert arrays["image_names"].tolist() == world.images("yard")
        assert arrays["depth"].shape == (6, 24, 32)  # the photos' proportions
        rotation = arrays["extrinsics"][:, :, :3]
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)
    assert run_main("check", out) == 0
    assert run_main("eval", "reconstruction", out, "--out", tmp_path / "out") == 0
    scored = world.score(out).scored["yard"].records.to_dict("records")[0]
    assert scored["points"] == 6 * 24 * 32
    assert scored["pose_auc_3deg"] < 0.2


def test_the_seed_decides(world: World, tmp_path: Path) -> None:
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        assert run_main("template", PROTOCOL, "--out", tmp_path / name, "--seed", seed) == 0
    one, again, other = ((tmp_path / name / "lot.npz").read_bytes() for name in "abc")
    assert one == again != other


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (("--out", "preds.npz"), "written as a folder, and this is the name of a file"),
        (("--out", "full"), "written as a folder, and this is there and not empty"),
        (("--kind", "descriptors"), "templates of reconstruction have no kind 'descriptors'"),
    ],
)
def test_where_it_cannot_be_written(
    arguments: tuple[str, ...],
    fragment: str,
    world: World,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a").write_text("")
    assert run_main("template", PROTOCOL, *arguments) == 2
    assert fragment in capsys.readouterr().err


def test_the_default_is_a_folder(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_main("template", PROTOCOL) == 0
    assert (tmp_path / "template" / "protocol.txt").read_text() == PROTOCOL + "\n"
