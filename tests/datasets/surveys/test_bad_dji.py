"""Folders of DJI photos that `prepare` refuses: one message each, and nothing written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.datasets.surveys.dji_folders import dji_folder, write_time_stamps
from tests.datasets.surveys.survey import (
    NAMES,
    Made,
    prior_file,
)
from tests.support import files_below, run_main


def stamps_of_others(made: Made) -> Path:
    folder = dji_folder(made)
    write_time_stamps(made, folder, off_deg=1e-3)
    return folder


def stamps_unlike(made: Made) -> Path:
    folder = dji_folder(made)
    (folder / "a_Timestamp.MRK").write_text("1\t282401.66\t[2404]\t22.77,Lat\t114.1,Lon\n")
    return folder


def stamps_unnumbered(made: Made) -> Path:
    folder = dji_folder(made)
    write_time_stamps(made, folder)
    for name in NAMES:
        (folder / name).rename(folder / name.replace("000", "900"))
    return folder


def stamps_of_another_datum(made: Made) -> Path:
    """All photos but the last have a time stamp, 45 m above what they say themselves."""
    folder = dji_folder(made)
    high = replace(made, centres=made.centres + np.array((0, 0, 45)))
    path = write_time_stamps(high, folder)
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-1]))
    return folder


def stripped(made: Made) -> Path:
    return dji_folder(made, without=("GimbalYawDegree",))


def stamps_of_two_flights(made: Made) -> Path:
    folder = dji_folder(made)
    first = write_time_stamps(made, folder, off_deg=2e-5).read_text()
    path = write_time_stamps(made, folder)
    path.write_text(path.read_text() + first)
    return folder


WRONG: dict[str, tuple[Callable[[Made], Path], list[str]]] = {
    "heights of two datums": (
        stamps_of_another_datum,
        ["time stamps are +45.0 m from the photos' own heights (median)", "1 of 5 (DJI_0005.JPG)"],
    ),
    "time stamps of two flights": (
        stamps_of_two_flights,
        ["several time stamps have one number: 5 of 5 (first 3: 1, 2, 3)"],
    ),
    "photos made smaller": (
        # As if the photo had been 80 px wide: 42 px are 36 mm, 84 px are 72 mm.
        lambda made: dji_folder(made, film_mm=36, changes={"DewarpData": "d;84,84,0,0,0,0,0,0,0"}),
        ["DJI_0001.JPG: DJI's DewarpData has fx = 84 px", "makes 41.6025 px", "--camera"],
    ),
    "no RTK": (
        lambda made: dji_folder(made, flags=(None, None, 34, 34, 16)),
        ["1 with RtkFlag 16, 2 with RtkFlag 34, 2 with no RtkFlag", "--rtk any"],
    ),
    "no angles": (stripped, ["no photo has a position, an altitude and gimbal angles"]),
    "time stamps of others": (stamps_of_others, ["more than 5 m from the photos of their number"]),
    "unlike time stamps": (stamps_unlike, ["a_Timestamp.MRK, line 1: holds 5 numbers: '1 282401"]),
    "no such numbers": (stamps_unnumbered, ["no photo has the number of a time stamp"]),
    "no lens": (
        lambda made: dji_folder(made, without=("DewarpData",)),
        ["photos state no camera: 5 of 5", "--camera"],
    ),
    "a broken lens": (
        lambda made: dji_folder(made, changes={"DewarpData": "2024-05-01;1,2,3"}),
        ["DJI_0001.JPG: DJI's DewarpData is '1,2,3'", "9 numbers"],
    ),
    "a lens in mm": (
        lambda made: dji_folder(made, changes={"DewarpData": "d;3.6,3.6,0,0,0,0,0,0,0"}),
        ["fx = 3.6 px in a photo 40 px wide"],
    ),
    "no take-off": (
        lambda made: dji_folder(made, without=("RelativeAltitude",)),
        ["no surface model, and photos have no RelativeAltitude", "--dsm"],
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_one_message_and_nothing_written(
    what: str, made: Made, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make, expected = WRONG[what]
    folder = make(made)
    maps = ("--dom", made.dom) if what == "no take-off" else made.maps

    assert run_main("prepare", "dji", "--source", folder, *maps, "--name", "place") == 2

    said = capsys.readouterr().err
    for text in expected:
        assert text in said
    assert not data.exists() or files_below(data) == set()


def test_priors_that_are_the_truth_are_refused(
    made: Made, capsys: pytest.CaptureFixture[str]
) -> None:
    sources = ("--source", dji_folder(made), *made.maps, "--priors", prior_file(made, 0.0))

    assert run_main("prepare", "dji", *sources, "--name", "place") == 2

    assert "its positions are the truth" in capsys.readouterr().err
