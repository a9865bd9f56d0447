"""Tables of poses: columns by their names, cameras, and what a table must not leave open."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from airzoo_bench.core.errors import UserError
from airzoo_bench.datasets.surveys.lenses import lens_of
from airzoo_bench.datasets.surveys.names import match_names
from airzoo_bench.geometry.units import grid_convergence_deg
from tests.datasets.surveys.layouts import (
    CRS,
    NAMES,
    Made,
    exact,
    gimbal_table,
    metashape_table,
    photogrammetric,
    photos_layout,
    pix4d_table,
    read_scene,
    write_table,
)
from tests.support import files_below, run_main

GIMBAL = "image,longitude,latitude,altitude,GimbalYawDegree,GimbalPitchDegree,GimbalRollDegree"


def edited(arguments: list[object], *changes: tuple[str, str]) -> list[object]:
    """Change the text of the table."""
    path = Path(str(arguments[2]))
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return arguments


def semicolons(made: Made) -> list[object]:
    """Write as a spreadsheet of this language does: decimal commas, a byte-order mark."""
    arguments = edited(gimbal_table(made), (",", ";"), (".JPG", "_JPG"), (".", ","))
    return edited(arguments, ("_JPG", ".JPG"), ("image", "\ufeffimage"))


def radians(made: Made) -> list[object]:
    rows = exact(made.lonlat, made.centres[:, 2], np.radians(made.gimbal()))
    return write_table(made, GIMBAL, rows)


def on_the_grid(made: Made) -> list[object]:
    rows = exact(made.lonlat, made.centres[:, 2], made.gimbal(0.0))
    return write_table(made, GIMBAL, rows)


def true_kappa(made: Made) -> list[object]:
    """Write omega, phi, kappa about true north."""
    convergence = np.radians(grid_convergence_deg(CRS, made.lonlat))
    sine, cosine, zero = np.sin(convergence), np.cos(convergence), np.zeros(5)
    to_grid = np.array([(cosine, -sine, zero), (sine, cosine, zero), (zero, zero, zero + 1)])
    turned = Made(
        made.folder,
        made.rotation @ to_grid.transpose(2, 0, 1),
        made.centres,
        made.lonlat,
        made.lens,
    )
    rows = exact(made.lonlat, made.centres[:, 2], photogrammetric(turned))
    return write_table(made, "image,lon,lat,height,omega,phi,kappa", rows)


def lower_case(made: Made) -> list[object]:
    return edited(gimbal_table(made), ("DJI_", "c:\\survey\\dji_"), (".JPG", ".jpg"))


def without_endings(made: Made) -> list[object]:
    return edited(metashape_table(made), (".JPG", ""))


def named_columns(made: Made) -> list[object]:
    """Write names as people do, with units."""
    names = "File name,Longitude [deg],Latitude [deg],Altitude (m),Yaw [deg],Pitch [deg],Roll [deg]"
    return [*edited(gimbal_table(made), (GIMBAL, names)), "--angles", "gimbal"]


SAME: dict[str, tuple[Callable[[Made], list[object]], list[object]]] = {
    "semicolons, decimal commas": (semicolons, []),
    "radians": (radians, ["--angle-unit", "radians"]),
    "yaw from the grid's north": (on_the_grid, ["--north", "grid"]),
    "kappa from true north": (true_kappa, ["--north", "true"]),
    "paths in lower case": (lower_case, []),
    "labels without endings": (without_endings, []),
    "other names": (named_columns, []),
}


@pytest.mark.parametrize("what", SAME)
def test_same_poses(what: str, made: Made) -> None:
    write, more = SAME[what]
    expected = read_scene(photos_layout(made))

    found = read_scene([*write(made), *more])

    assert found.names == NAMES
    np.testing.assert_allclose(found.poses.centres, expected.poses.centres, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.poses.rotation, expected.poses.rotation, rtol=0, atol=1e-9)


def test_what_was_found_is_taken_and_said(made: Made) -> None:
    arguments = edited(metashape_table(made))
    lines = Path(str(arguments[2])).read_text().splitlines()
    lines[3] = ",".join([*lines[3].split(",")[:7], *[""] * 6])  # not aligned
    Path(str(arguments[2])).write_text("\n".join(lines))

    found = read_scene(arguments)

    assert found.unposed == (NAMES[1],)
    said = " ".join(found.notes)
    assert "poses that the program found are from the columns X_est, Y_est, Z_est, Yaw_est" in said
    assert "rows without a position or angles: 1 of 5 (DJI_0002.JPG)" in said
    assert "angles are read as airframe, relative to true north" in said


def test_photos_and_rows_without_each_other_are_named(made: Made) -> None:
    arguments = gimbal_table(made)
    (made.images / NAMES[0]).rename(made.images / "IMG_1.JPG")

    found = read_scene(arguments)

    assert found.names == NAMES[1:]
    assert found.unposed == ("IMG_1.JPG",)
    assert "rows whose photo is not there: 1 of 5 (DJI_0001.JPG)" in found.notes


@pytest.mark.parametrize(
    ("values", "focal"),
    [
        ({"fx": 50.0}, (50.0, 50.0)),
        ({"fx": 50.0, "fy": 51.0}, (50.0, 51.0)),
        ({"focal_mm": 10.0, "sensor_mm": 8.0}, (50.0, 50.0)),
        ({"fov_deg": 90.0}, (20.0, 20.0)),
    ],
)
def test_cameras_by_hand(values: dict[str, float], focal: tuple[float, float]) -> None:
    (first, second, _), distortion = lens_of(values, (40, 30), "camera.json")

    assert (first[0], second[1]) == pytest.approx(focal)
    assert (first[2], second[2]) == (20.0, 15.0)
    assert distortion == (0, 0, 0, 0, 0)


def test_a_camera_in_columns(made: Made) -> None:
    arguments = gimbal_table(made)
    path = Path(str(arguments[2]))
    header, *rows = path.read_text().splitlines()
    rows = [f"{row},{40 + i}" for i, row in enumerate(rows)]
    path.write_text("\n".join([f"{header},fov_deg", *rows]))

    found = read_scene(arguments[: arguments.index("--camera")])

    expected = 20.0 / np.tan(np.radians(np.arange(40, 45)) / 2)
    np.testing.assert_allclose(found.cameras.focal[:, 0], expected)


def test_names_that_could_be_two_photos_are_none() -> None:
    photos = ["a/1.jpg", "b/1.jpg", "2.jpg"]
    assert match_names(["1.jpg", "B/1.JPG", "x/2.JPG"], photos, "t") == {
        "B/1.JPG": "b/1.jpg",
        "x/2.JPG": "2.jpg",
    }
    with pytest.raises(UserError, match=r"more than one name means 1 of 3 \(2.jpg\)"):
        match_names(["2.jpg", "x/2.JPG"], photos, "t")


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
        path = Path(str(arguments[2]))
        header, *rows = path.read_text().splitlines()
        path.write_text("\n".join([f"{header},fx", *(f"{row},17.0" for row in rows)]))
        return arguments[: arguments.index("--camera")]

    return write


def with_film(made: Made, focal_mm: int) -> None:
    for name in NAMES:
        with Image.open(made.images / name) as image:
            exif = image.getexif()
            exif.get_ifd(0x8769)[0xA405] = focal_mm
            image.save(made.images / name, "JPEG", exif=exif)


@pytest.mark.parametrize(
    ("film", "said"), [(None, "which no EXIF confirms"), (36, "by EXIF in 5 of 5")]
)
def test_the_size_that_fx_is_taken_for_is_said(made: Made, film: int | None, said: str) -> None:
    if film is not None:
        with_film(made, film)
    arguments = gimbal_table(made)
    Path(str(arguments[-1])).write_text('{"fx": 42.0}')

    assert f"fx is taken for photos of 1 size (40x30) px, {said}" in read_scene(arguments).notes


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
    "no table": (
        header('"' + "x" * 200_000),
        ["poses.csv: not a table: field larger than field limit"],
    ),
    "gon unsaid": (gon, ["look like gon", "at most 360"]),
    "gon said": (
        header(GIMBAL.replace("GimbalYawDegree", "GimbalYaw (gon)")),
        ["columns in other units: 'GimbalYaw (gon)'"],
    ),
    "feet said": (
        header(GIMBAL.replace("altitude", "Altitude [US ft]")),
        ["columns in other units: 'Altitude [US ft]'", "lengths in metres"],
    ),
    "radians said": (
        header(GIMBAL.replace("GimbalYawDegree", "GimbalYaw (rad)")),
        ["say that they are in radians", "--angle-unit radians"],
    ),
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
