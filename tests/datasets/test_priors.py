"""Priors from a table, and priors turned against the poses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from airzoo_bench.datasets.priors import prior_errors, turned_priors
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rotations import angles_to_rotations
from tests.datasets.tagged import NAMES, tag
from tests.geometry.support import quick, seeds
from tests.support import Place, run_main


def test_priors_from_a_table(place: Place, capsys: pytest.CaptureFixture[str]) -> None:
    for name in NAMES:
        tag(place, name, yaw=None)
    assert run_main(*place.arguments()) == 0
    assert "4 of 4 photos have no prior: 4 (first" in capsys.readouterr().err
    table = place.dsm.with_name("priors.csv")
    rows = "".join(f"{name},1.5,-88,0,\n" for name in NAMES)
    table.write_text(f"image,yaw_deg,pitch_deg,roll_deg,altitude_m\n{rows}")
    assert run_main(*place.arguments(priors=table), "--force") == 0
    said = capsys.readouterr()
    assert "priors          4, off by 2.9 m; yaw 1.5, pitch 2.0, rotation 2.5 degrees" in said.out
    assert "warning" not in said.err
    assert run_main("check-geometry", "park") == 0
    assert "passes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("", "has the columns "),
        ("name,yaw_deg\na.jpg,1\n", "has the columns name, yaw_deg"),
        ("image,heading\na.jpg,1\n", "expected: image, and some of lon, lat"),
        ("image,yaw_deg\na.jpg,1,2\n", "has the columns None, image, yaw_deg"),
        ("image,yaw_deg\na.jpg,1\na.jpg,2\n", "named twice: 1 ('a.jpg')"),
        ("image,yaw_deg,yaw_deg\na.jpg,1,2\n", "has the columns image, yaw_deg, yaw_deg"),
        ("image,yaw_deg\na.jpg,1_0\n", "column yaw_deg, line 2: '1_0'"),
        ("image,yaw_deg\nz.jpg,1\n", "no photos: 1 ('z.jpg')"),
        ("image,yaw_deg\na.jpg,north\n", "column yaw_deg, line 2: 'north'"),
        ("image,yaw_deg\na.jpg,nan\n", "column yaw_deg, line 2: 'nan'"),
        ("image,lat\na.jpg,93\n", "column lat, line 2: '93'"),
    ],
)
def test_bad_tables_of_priors(
    table: str, said: str, place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    path = place.dsm.with_name("priors.csv")
    path.write_text(table)
    assert run_main(*place.arguments(priors=path)) == 2
    message = capsys.readouterr().err
    assert said in message
    assert "priors.csv" in message


@quick
@given(seeds)
def test_turned_priors_are_told_from_the_truth(seed: int) -> None:
    rng = np.random.default_rng(seed)
    yaw, pitch, roll = rng.uniform((-180, -85, -5), (180, -50, 5), (12, 3)).T
    noise = Rotation.from_rotvec(rng.normal(0, 2, (12, 3)), degrees=True).as_matrix()

    def poses(yaw: Any, pitch: Any, roll: Any) -> Poses:
        rotations = noise @ angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
        return Poses.from_centres(rotations, np.zeros((12, 3)))

    truth = Poses.from_centres(
        angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0), np.zeros((12, 3))
    )
    assert turned_priors(poses(yaw, pitch, roll), truth) == {}
    _, _, pitch_deg, rotation_deg = prior_errors(poses(yaw, pitch, roll), truth)
    assert (rotation_deg < 15).all()
    assert (pitch_deg <= rotation_deg + 1e-9).all()
    half = turned_priors(poses(np.where(np.arange(12) < 5, yaw + 180, yaw), pitch, roll), truth)
    ((what, rows),) = half.items()
    assert what == "yaw is 180 degrees off"
    assert rows.tolist() == [True] * 5 + [False] * 7
    for off, what in ((90, "yaw is 90 degrees too large"), (-90, "yaw is 90 degrees too small")):
        ((found, rows),) = turned_priors(poses(yaw + off, pitch, roll), truth).items()
        assert (found, rows.all()) == (what, True)
    away = np.abs(np.abs(yaw) % 90 - 45) < 20
    negated = turned_priors(poses(-yaw, pitch, roll), truth)
    assert not away.any() or next(iter(negated)) in (
        "yaw has the wrong sign",
        "yaw is 180 degrees off",
    )
    nonsense = turned_priors(poses(yaw + 135, pitch, roll), truth)
    assert list(nonsense)[-1] == "rotation is more than 45 degrees off"
    assert sum(nonsense.values()).tolist() == [1] * 12


MISTAKES = {
    "yaw has the wrong sign": lambda yaw, pitch, roll: (-yaw, pitch, roll),
    "yaw is 180 degrees off": lambda yaw, pitch, roll: (yaw + 180, pitch, roll),
    "yaw is 90 degrees too large": lambda yaw, pitch, roll: (yaw + 90, pitch, roll),
    "yaw is 90 degrees too small": lambda yaw, pitch, roll: (yaw - 90, pitch, roll),
    "pitch has the wrong sign": lambda yaw, pitch, roll: (yaw, -pitch, roll),
}


def named(rotations: Any, angles: Any, mistake: str) -> dict[str, list[bool]]:
    """Return what is said of gimbal angles with a mistake, and with the noise of a gimbal."""
    angles = angles + np.random.default_rng(0).normal(0, 0.5, angles.shape)
    given = angles_to_rotations(*MISTAKES[mistake](*angles.T), convergence_deg=0.0)
    nowhere = np.zeros((len(angles), 3))
    truth, priors = (Poses.from_centres(turned, nowhere) for turned in (rotations, given))
    return {what: rows.tolist() for what, rows in turned_priors(priors, truth).items()}


@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.parametrize("pitch", [-60.0, -87.0])
@pytest.mark.parametrize("yaw", [45.0, -45.0, 132.0, 33.0, 60.0])
def test_the_mistake_that_explains_best_is_named(mistake: str, yaw: float, pitch: float) -> None:
    angles = np.array([(yaw + off, pitch, 0.0) for off in np.linspace(-7, 7, 15)])
    rotations = angles_to_rotations(*angles.T, convergence_deg=0.0)
    assert named(rotations, angles, mistake) == {mistake: [True] * 15}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_the_mistake_is_named_at_the_yaws_of_a_flight(mistake: str, brighton: Path) -> None:
    photos = json.loads((brighton / "poses.json").read_text())["images"].values()
    rotations = np.array([photo["R_w2c"] for photo in photos])
    # Looking down, yaw is where the top of the photo points: by 37 to 50 degrees, or the opposite.
    up, pitch = -rotations[:, 1], np.degrees(np.arcsin(rotations[:, 2, 2]))
    yaw = np.degrees(np.arctan2(up[:, 0], up[:, 1]))
    angles = np.stack([yaw, pitch, np.zeros(18)], axis=1)
    assert named(rotations, angles, mistake) == {mistake: [True] * 18}
