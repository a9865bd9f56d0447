"""Tables of poses: columns by their names, cameras, and what is taken from them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.datasets.surveys.lenses import lens_of
from airzoo_bench.datasets.surveys.names import match_names
from airzoo_bench.geometry.crs import grid_convergence_deg
from tests.datasets.surveys.edited_tables import GIMBAL, edited, radians, with_film
from tests.datasets.surveys.pose_tables import (
    exact,
    gimbal_table,
    metashape_table,
    photogrammetric,
    write_table,
)
from tests.datasets.surveys.survey import CRS, NAMES, Made, photos_layout, read_scene


def semicolons(made: Made) -> list[object]:
    """Write as a spreadsheet of this language does: decimal commas, a byte-order mark."""
    arguments = edited(gimbal_table(made), (",", ";"), (".JPG", "_JPG"), (".", ","))
    return edited(arguments, ("_JPG", ".JPG"), ("image", "\ufeffimage"))


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


@pytest.mark.parametrize(
    ("film", "said"), [(None, "which no EXIF confirms"), (36, "by EXIF in 5 of 5")]
)
def test_the_size_that_fx_is_taken_for_is_said(made: Made, film: int | None, said: str) -> None:
    if film is not None:
        with_film(made, film)
    arguments = gimbal_table(made)
    Path(str(arguments[-1])).write_text('{"fx": 42.0}')

    assert f"fx is taken for photos of 1 size (40x30) px, {said}" in read_scene(arguments).notes
