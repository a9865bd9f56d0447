"""Tables of poses that leave something open, or state what cannot be: one message each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.datasets.surveys.edited_tables import GIMBAL, edited, radians, with_film
from tests.datasets.surveys.pose_tables import (
    exact,
    gimbal_table,
    photogrammetric,
    pix4d_table,
    write_table,
)
from tests.datasets.surveys.survey import CRS, Made
from tests.support import files_below, run_main


def swapped(made: Made) -> list[object]:
    rows = exact(made.lonlat + np.array((100.0, 0.0)), made.centres[:, 2], made.gimbal())
    return write_table(made, GIMBAL.replace("longitude,latitude", "latitude,longitude"), rows)


def plain_angles(made: Made) -> list[object]:
    return edited(
        gimbal_table(made), ("GimbalYawDegree,GimbalPitchDegree,GimbalRollDegree", "yaw,pitch,roll")
    )


def as_pix4d(made: Made) -> list[object]:
    """Write gimbal angles where Pix4D's are expected."""
    arguments = plain_angles(made)
    return edited(arguments, ("image,", "imagename,"))


def oblique(made: Made) -> list[object]:
    """Write gimbal angles of oblique photos where Metashape's are expected."""
    angles = made.gimbal()
    angles[:, 1] = -45.0
    rows = exact(made.lonlat, made.centres[:, 2], angles)
    return write_table(made, "Label,longitude,latitude,altitude,Yaw,Pitch,Roll", rows)


def of_smaller_photos(in_columns: bool) -> Callable[[Made], list[object]]:
    """Give fx of photos half as wide as those that are there, by their EXIF."""

    def write(made: Made) -> list[object]:
        with_film(made, 29)
        arguments = gimbal_table(made)
        if not in_columns:
            Path(str(arguments[-1])).write_text('{"fx": 17.0}')
            return arguments
        return with_column(arguments, "fx", "17.0")[: arguments.index("--camera")]

    return write


def with_column(arguments: list[object], name: str, value: str) -> list[object]:
    path = Path(str(arguments[2]))
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"{header},{name}", *(f"{row},{value}" for row in rows)]))
    return arguments


def without(option: str) -> Callable[[Made], list[object]]:
    def write(made: Made) -> list[object]:
        arguments = pix4d_table(made) if option == "--crs" else gimbal_table(made)
        place = arguments.index(option)
        return [*arguments[:place], *arguments[place + 2 :]]

    return write


def bad_camera(text: str) -> Callable[[Made], list[object]]:
    def write(made: Made) -> list[object]:
        arguments = gimbal_table(made)
        Path(str(arguments[-1])).write_text(text)
        return arguments

    return write


def header(new: str) -> Callable[[Made], list[object]]:
    return lambda made: edited(gimbal_table(made), (GIMBAL, new))


def gon(made: Made) -> list[object]:
    """Write omega, phi, kappa in gon, kappa to 400 of them."""
    angles = photogrammetric(made) / 0.9
    angles[:, 2] %= 400
    rows = exact(made.centres, angles)
    return [*write_table(made, "imageName X Y Z Omega Phi Kappa", rows, " "), "--crs", CRS]


WRONG: dict[str, tuple[Callable[[Made], list[object]], list[str]]] = {
    "gon unsaid": (gon, ["look like gon", "at most 360"]),
    "radians unsaid": (radians, ["look like radians", "--angle-unit radians"]),
    "which angles": (plain_angles, ["what yaw, pitch and roll mean", "pitch is -85 in the median"]),
    "another convention": (
        as_pix4d,
        ["5 cameras of 5 look more than 65 degrees away", "is -85 degrees", "--angles gimbal"],
    ),
    "oblique": (
        oblique,
        ["pitch is -45 degrees in the median", "two ways", "--angles gimbal or --angles airframe"],
    ),
    "fx of other photos": (
        of_smaller_photos(False),
        ["camera.json", "fx is 17 px", "film makes 33.51", "in a photo of 40x30 px: 5 of 5"],
    ),
    "fx in columns of other photos": (
        of_smaller_photos(True),
        ["poses.csv", "fx is 17 px", "makes 33.51"],
    ),
    "degrees as radians": (
        lambda made: [*gimbal_table(made), "--angle-unit", "radians"],
        ["which is no angle in radians", "leave out --angle-unit radians"],
    ),
    "a camera of half the size": (
        bad_camera('{"fx": 21, "cx": 10, "cy": 7.5}'),
        ["camera matrices of another image size", "(10.0, 7.5)", "scale K"],
    ),
    "which CRS": (without("--crs"), ["the CRS of the columns X and Y", "--crs EPSG:32633"]),
    "no camera": (without("--camera"), ["no camera is given", "focal_mm and sensor_mm"]),
    "no map": (without("--dom"), ["--dom must be given"]),
    "no ground": (without("--dsm"), ["--dsm or --plane-height must be given"]),
    "swapped": (swapped, ["no longitude and latitude", "the wrong way round"]),
    "no header": (header("1,2,3,4,5,6,7"), ["has no line that names its columns"]),
    "no height": (
        header(GIMBAL.replace("altitude", "hight")),
        ["lacks height (did you mean 'hight'?)", "'image, longitude, latitude, hight"],
    ),
    "a heading": (
        header(GIMBAL.replace("GimbalYawDegree", "heading")),
        ["lacks yaw, pitch and roll", "(did you mean yaw by 'heading'? Rename it)"],
    ),
    "twice the same": (
        header(GIMBAL.replace("GimbalYawDegree", "Lng")),
        ["columns that mean the same: 'longitude' and 'Lng'"],
    ),
    "a line cut off": (
        lambda made: edited(gimbal_table(made), ("DJI_0003.JPG,", "DJI_0003.JPG\nx,")),
        ["line 4: has 1 value for 7 columns"],
    ),
    "decimal commas": (
        lambda made: edited(gimbal_table(made), (".JPG", "_"), (".", ","), ("_", ".JPG")),
        ["has 13 values for 7 columns", "decimal point"],
    ),
    "no number": (
        lambda made: edited(gimbal_table(made), ("180.0", "high")),
        ["line 2", "'high'", "a number"],
    ),
    "a name twice": (
        lambda made: edited(gimbal_table(made), ("DJI_0002", "DJI_0001")),
        ["column image", "1 value ('DJI_0001.JPG')"],
    ),
    "other photos": (
        lambda made: edited(gimbal_table(made), ("DJI_", "IMG_")),
        ["none of its 5 names is among 5 photos", "'IMG_0001.JPG'"],
    ),
    "a folder": (
        lambda made: ["poses", "--source", made.images, *gimbal_table(made)[3:]],
        ["folder"],
    ),
    "a wrong key": (
        bad_camera('{"focal_m": 1}'),
        ["unknown key 'focal_m' (did you mean 'focal_mm'?)"],
    ),
    "no focal length": (bad_camera('{"cx": 1}'), ["the focal length does not follow from cx"]),
    "no JSON": (bad_camera("fx=42"), ["camera.json", "not JSON"]),
    "another size": (
        bad_camera('{"fx": 42, "width": 4000, "height": 3000}'),
        ["for photos of 4000x3000 px, not 40x30"],
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_one_message_and_nothing_written(
    what: str, made: Made, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write, expected = WRONG[what]
    arguments = write(made)
    before = files_below(made.folder)

    assert run_main("prepare", *arguments, "--name", "place") == 2

    said = capsys.readouterr().err
    for text in expected:
        assert text in said
    assert files_below(made.folder) == before
    assert not data.exists() or files_below(data) == set()
