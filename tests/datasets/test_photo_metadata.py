"""Positions and gimbal angles in photos, and the poses that they make.

Damaged metadata is in tests/goldens/refusals.txt.
"""

from __future__ import annotations

import json
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL.TiffImagePlugin import IFDRational

from airzoo_bench.datasets.metadata import PhotoPrior, priors_to_poses, read_prior
from airzoo_bench.geometry.poses import rotation_angle_deg
from tests.datasets.support import packet, write_photo

LON, LAT = -(91 + 59 / 60 + 40.4156 / 3600), 46 + 50 / 60 + 33.3855 / 3600
GPS = {1: "N", 2: (46.0, 50.0, 33.3855), 3: "W", 4: (91.0, 59.0, 40.4156), 5: b"\0", 6: 198.309}
ABOVE = {key: value for key, value in GPS.items() if key != 5}  # without a reference of height
SOUTH_EAST = {1: "S", 2: (33.0, 30.0, 36.0), 3: "E", 4: (151.0, 0, 0)}
ZEROS, UNKNOWN = (0.0, 0.0, 0.0), IFDRational(0, 0)
ANGLES = packet(
    GimbalYawDegree="+45.00",
    GimbalPitchDegree="-89.90",
    GimbalRollDegree="-0.00",
    RelativeAltitude="+39.80",
)
PLACE = {"GpsLatitude": "-28.5", "AbsoluteAltitude": "+80.5", "GpsStatus": "RTK"}
STATED = packet(**PLACE, GpsLongitude="+112.25")


def photo(folder: Path, gps: Any, xmp: Any) -> Path:
    write_photo(folder / "DJI_0001.JPG", (16, 8), gps, xmp)
    return folder / "DJI_0001.JPG"


@pytest.mark.parametrize(
    ("gps", "xmp", "expected"),
    [
        (GPS, ANGLES, (LON, LAT, 198.309, 45.0, -89.9, 0.0, 39.8)),
        # A position of XMP stands in for that of EXIF, also where it is misspelt.
        (None, STATED, (112.25, -28.5, 80.5)),
        (None, packet(**PLACE, GpsLongtitude="+112.25"), (112.25, -28.5, 80.5)),
        (GPS, STATED, (LON, LAT, 198.309)),
        (SOUTH_EAST, None, (151.0, -33.51)),
        *(
            (ABOVE | reference, None, (LON, LAT, sign * 198.309))
            for reference, sign in (
                *(({5: b"\0"}, 1), ({5: b"\1"}, -1), ({5: b"\2"}, 1), ({5: b"\3"}, -1)),
                ({}, 1),
            )
        ),
        (None, None, ()),
        (None, packet(GimbalYawDegree=""), ()),
        (GPS | {2: ZEROS, 4: ZEROS}, None, (None, None, 198.309)),
        (GPS | {2: (UNKNOWN,) * 3, 6: UNKNOWN}, None, ()),
        (None, b"<not xml of DJI", ()),  # other programs' is not looked at
    ],
)
def test_a_photo_states_these(gps: Any, xmp: Any, expected: Any, tmp_path: Path) -> None:
    found = vars(read_prior(photo(tmp_path, gps, xmp))).values()
    for value, one in zip_longest(found, expected):
        assert value == (None if one is None else pytest.approx(one, abs=1e-8))


def test_a_pose_worked_by_hand() -> None:
    # On the central meridian of UTM 15 the grid's north is true, and x is 500,000.
    prior = PhotoPrior(-93.0, 0.0, 120.0, 90.0, 0.0, 0.0, None)
    pose = priors_to_poses({"a.jpg": prior}, 32615)
    np.testing.assert_allclose(pose.centres, ((500_000.0, 0.0, 120.0),), rtol=0, atol=1e-6)
    expected = (((0, -1, 0), (0, 0, -1), (1, 0, 0)),)
    np.testing.assert_allclose(pose.rotation, expected, rtol=0, atol=1e-9)


def test_the_real_scene_and_its_trap(brighton: Path) -> None:
    scene = json.loads((brighton / "poses.json").read_text())
    names = sorted(scene["images"])
    priors = {name: read_prior(brighton / "images" / name) for name in names}
    poses = priors_to_poses(priors, scene["crs"])
    gps = [scene["images"][name]["gps_utm"] for name in names]
    np.testing.assert_allclose(poses.centres, gps, rtol=0, atol=1e-3)
    truth = np.array([scene["images"][name]["R_w2c"] for name in names])
    off = rotation_angle_deg(poses.rotation, truth)
    turned = np.array(["DJI_0024" <= name[:8] <= "DJI_0029" for name in names])
    assert turned.sum() == 6
    assert off[~turned].max() < 8
    assert off[turned].min() > 172
    assert priors[names[0]].relative_altitude_m == 39.8
