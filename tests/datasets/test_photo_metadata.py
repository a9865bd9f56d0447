from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.datasets.metadata import PhotoPrior, priors_to_poses, read_prior
from airzoo_bench.geometry.poses import rotation_angle_deg
from tests.datasets.xmp import packet

GPS = {1: "N", 2: (46.0, 50.0, 33.3855), 3: "W", 4: (91.0, 59.0, 40.4156), 5: b"\0", 6: 198.309}
ANGLES = (
    'drone-dji:GimbalYawDegree="+45.00" drone-dji:GimbalPitchDegree="-89.90" '
    'drone-dji:GimbalRollDegree="-0.00" drone-dji:RelativeAltitude="+39.80"'
)
NOTHING = PhotoPrior(None, None, None, None, None, None, None)
PRIOR = PhotoPrior(
    lon=-(91 + 59 / 60 + 40.4156 / 3600),
    lat=46 + 50 / 60 + 33.3855 / 3600,
    altitude_m=198.309,
    yaw_deg=45.0,
    pitch_deg=-89.9,
    roll_deg=0.0,
    relative_altitude_m=39.8,
)


def jpg(gps: dict[int, Any] | None = None, xmp: bytes | None = None) -> bytes:
    exif = Image.Exif()
    if gps is not None:
        exif.get_ifd(0x8825).update(gps)
    stream = io.BytesIO()
    Image.new("L", (16, 8)).save(stream, "JPEG", exif=exif)
    content = stream.getvalue()
    if xmp is None:
        return content
    data = b"http://ns.adobe.com/xap/1.0/\0" + xmp
    return content[:2] + b"\xff\xe1" + (len(data) + 2).to_bytes(2) + data + content[2:]


@pytest.fixture
def photo(tmp_path: Path) -> Any:
    def write(gps: dict[int, Any] | None = None, xmp: bytes | None = None) -> Path:
        path = tmp_path / "DJI_0001.JPG"
        path.write_bytes(jpg(gps, xmp))
        return path

    return write


def assert_near(found: PhotoPrior, expected: PhotoPrior) -> None:
    for name, value in vars(expected).items():
        assert getattr(found, name) == (None if value is None else pytest.approx(value, abs=1e-8))


def test_everything_a_photo_says(photo: Any) -> None:
    assert_near(read_prior(photo(GPS, packet(ANGLES))), PRIOR)


@pytest.mark.parametrize("name", ["GpsLongitude", "GpsLongtitude"])
def test_position_of_xmp_stands_in_for_exif(photo: Any, name: str) -> None:
    xmp = packet(
        f'drone-dji:GpsLatitude="-28.5" drone-dji:{name}="+112.25" '
        'drone-dji:AbsoluteAltitude="+80.5" drone-dji:GpsStatus="RTK"'
    )
    alone = read_prior(photo(None, xmp))
    assert (alone.lon, alone.lat, alone.altitude_m) == (112.25, -28.5, 80.5)
    assert_near(
        read_prior(photo(GPS, xmp)), PhotoPrior(PRIOR.lon, PRIOR.lat, 198.309, *(None,) * 4)
    )


@pytest.mark.parametrize(
    ("code", "sign"), [(b"\0", 1), (b"\1", -1), (b"\2", 1), (b"\3", -1), (None, 1)]
)
def test_altitude_below_sea_level(photo: Any, code: bytes | None, sign: int) -> None:
    gps = {tag: value for tag, value in {**GPS, 5: code}.items() if value is not None}
    assert read_prior(photo(gps)).altitude_m == pytest.approx(sign * 198.309)


def test_signs_of_the_hemispheres(photo: Any) -> None:
    found = read_prior(photo({1: "S", 2: (33.0, 30.0, 36.0), 3: "E", 4: (151.0, 0.0, 0.0)}))
    assert (found.lon, found.lat) == (151.0, pytest.approx(-33.51))
    assert found.altitude_m is None


def test_what_a_photo_does_not_say_is_none(photo: Any) -> None:
    assert read_prior(photo()) == NOTHING
    assert read_prior(photo(None, packet('drone-dji:GimbalYawDegree=""'))) == NOTHING
    assert read_prior(photo({**GPS, 2: (0.0, 0.0, 0.0), 4: (0.0, 0.0, 0.0)})).lon is None
    unknown = IFDRational(0, 0)
    assert read_prior(photo({**GPS, 2: (unknown,) * 3, 6: unknown})).lat is None
    # What other programs write is not looked at, sound or not.
    assert read_prior(photo(None, b"<not xml")) == NOTHING


BOMB = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;">]>'
OUTSIDE = '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/hostname">]>'


@pytest.mark.parametrize(
    ("gps", "xmp"),
    [
        (None, packet(before=BOMB, elements="&b;")),
        (None, packet(before=OUTSIDE, elements="&a;")),
        (None, packet()[:-40]),
        (None, packet().replace(b"W5M0", b"\xff\xfe\xfd\xfc")),
        (None, packet('drone-dji:GimbalYawDegree="1_0"')),
        (None, packet('drone-dji:GimbalPitchDegree="nan"')),
        (None, packet('drone-dji:RelativeAltitude="+39,8"')),
        (None, packet('drone-dji:GpsLatitude="91" drone-dji:GpsLongitude="5"')),
        ({**GPS, 2: (91.0, 0.0, 0.0)}, None),
        ({**GPS, 2: (46.0, 50.0)}, None),
        ({**GPS, 1: "E"}, None),
        ({**GPS, 3: ""}, None),
    ],
)
def test_damaged_metadata_is_named(
    photo: Any, gps: dict[int, Any] | None, xmp: bytes | None
) -> None:
    path = photo(gps, xmp)
    with pytest.raises(BenchmarkError) as caught:
        read_prior(path)
    assert str(caught.value).startswith(str(path))


def test_files_that_are_no_photos(tmp_path: Path) -> None:
    path = tmp_path / "a.JPG"
    with pytest.raises(BenchmarkError, match="not a readable photo"):
        read_prior(path)
    for content in (b"", b"\xff\xd8\xff\xe1\xff\xff", b"GIF89a"):
        path.write_bytes(content)
        with pytest.raises(BenchmarkError, match="not a readable photo"):
            read_prior(path)


WHOLE = jpg(GPS, packet(ANGLES))


def test_a_pose_worked_by_hand() -> None:
    # On the central meridian of UTM 15 the grid's north is true, and x is 500,000.
    prior = PhotoPrior(-93.0, 0.0, 120.0, 90.0, 0.0, 0.0, None)
    pose = priors_to_poses({"a.jpg": prior}, 32615)
    np.testing.assert_allclose(pose.centres, ((500_000.0, 0.0, 120.0),), rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        pose.rotation, (((0, -1, 0), (0, 0, -1), (1, 0, 0)),), rtol=0, atol=1e-9
    )


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
