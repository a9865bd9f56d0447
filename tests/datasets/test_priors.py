"""Priors from a table, and priors turned against the poses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from airzoo_bench.datasets.priors import prior_errors
from airzoo_bench.geometry.poses import Poses, angles_to_rotations
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
    assert said.err.count("warning") == 1  # of the size of tiles
    assert run_main("check-geometry", "park") == 0


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
def test_errors_of_priors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    yaw, pitch, roll = rng.uniform((-180, -85, -5), (180, -50, 5), (12, 3)).T
    noise = Rotation.from_rotvec(rng.normal(0, 2, (12, 3)), degrees=True).as_matrix()
    rotations = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    truth = Poses.from_centres(rotations, np.zeros((12, 3)))
    _, _, pitch_deg, rotation_deg = prior_errors(
        Poses.from_centres(noise @ rotations, np.zeros((12, 3))), truth
    )
    assert (rotation_deg < 15).all()
    assert (pitch_deg <= rotation_deg + 1e-9).all()
