"""COLMAP models: residuals that are told, and georeferences that do not hold."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.datasets.surveys.colmap_models import (
    colmap_aligned_layout,
    colmap_exif_layout,
    colmap_matrix_layout,
    colmap_names_layout,
)
from tests.datasets.surveys.dji_folders import dji_folder
from tests.datasets.surveys.survey import NAMES, Made, read_scene
from tests.support import files_below, run_main


def test_residuals_and_outliers_are_told(made: Made) -> None:
    found = read_scene(colmap_names_layout(made))

    first, out = found.notes
    assert "a similarity of scale 0.99978 places the model by 4 of 5 positions" in first
    assert "0.000 m remain (root mean square)" in first
    assert (found.truth_accuracy_m or 0) < 5e-4
    assert out == "positions that do not fit: 1 of 5 (DJI_0003.JPG)"


def test_binary_models_with_rigs_and_frames(made: Made) -> None:
    """What pycolmap writes today has rigs.bin and frames.bin."""
    from airzoo_bench.core.optional_imports import load_pycolmap

    arguments = colmap_aligned_layout(made)
    expected = read_scene(arguments)
    folder = Path(str(arguments[2]))
    model = load_pycolmap().Reconstruction(str(folder))
    for path in folder.iterdir():
        path.unlink()
    model.write_binary(str(folder))

    found = read_scene(arguments)

    assert {path.name for path in folder.iterdir()} >= {"rigs.bin", "frames.bin", "images.bin"}
    np.testing.assert_allclose(found.poses.centres, expected.poses.centres, rtol=0, atol=1e-8)


def scattered(made: Made) -> list[object]:
    arguments = colmap_names_layout(made)
    path = Path(str(arguments[-1]))
    rng = np.random.default_rng(0)
    rows = zip(NAMES, (made.centres + rng.uniform(-90, 90, (5, 3))).tolist(), strict=True)
    path.write_text("".join(f"{name} {x} {y} {z}\n" for name, (x, y, z) in rows))
    return arguments


def georeference(text: str) -> Callable[[Made], list[object]]:
    def write(made: Made) -> list[object]:
        arguments = colmap_names_layout(made)
        Path(str(arguments[-1])).write_text(text)
        return arguments

    return write


def no_gps(made: Made) -> list[object]:
    arguments = colmap_exif_layout(made)
    dji_folder(made, without=("GpsLatitude", "GpsLongitude"))
    return arguments


WRONG: dict[str, tuple[Callable[[Made], list[object]], list[str]]] = {
    "nothing says where": (
        lambda made: colmap_aligned_layout(made)[:-2],
        ["where the model is, is not known", "--from-exif", "--georeference FILE"],
    ),
    "both": (lambda made: [*colmap_matrix_layout(made), "--from-exif"], ["exclude each other"]),
    "positions that disagree": (scattered, ["agree with the model to 5 m", "--inlier-m"]),
    "too few": (
        georeference("DJI_0001.JPG 1 2 3\nDJI_0002.JPG 1 2 4\n"),
        ["there are 2 positions for a model", "at least 4"],
    ),
    "no positions": (georeference("DJI_0001.JPG one two three\n"), ["holds the line", "4 x 4"]),
    "a name twice": (
        georeference("DJI_0001.JPG 1 2 3\nDJI_0001.JPG 1 2 4\n"),
        ["a name that it had before", "each name once"],
    ),
    "positions of others": (georeference("IMG_9.JPG 1 2 3\n"), ["none of its 1 name is among"]),
    "a mirror": (
        georeference("1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n"),
        ["mirrors or flattens", "a similarity"],
    ),
    "a shear": (
        georeference("1 0.5 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"),
        ["shears or mirrors", "a similarity"],
    ),
    "no GPS": (no_gps, ["no photo has a GPS position"]),
    "no model": (
        lambda made: ["colmap", "--source", made.images, *colmap_aligned_layout(made)[3:]],
        ["not a COLMAP model"],
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_one_message_and_nothing_written(
    what: str, made: Made, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write, expected = WRONG[what]

    assert run_main("prepare", *write(made), "--name", "place") == 2

    said = capsys.readouterr().err
    for text in expected:
        assert text in said
    assert not data.exists() or files_below(data) == set()
