"""Files of flights: what is written is read, and hostile files are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from airzoo_bench.core.errors import CameraError
from airzoo_bench.datasets.mini.flights import trajectory_files
from airzoo_bench.datasets.mini.flights.trajectory import (
    Trajectory,
    rounded,
)
from airzoo_bench.datasets.mini.flights.trajectory_files import read_trajectory, write_trajectory
from tests.datasets.mini.flights import flights, over_city

HEADER = "longitude,latitude,altitude,roll,pitch,yaw,time"


ROWS = ("113.1,28.2,120,0,-45,10,0", "113.1,28.2,121,0,-46,11,0.5", "113.1,28.2,122,0,-47,12,1")


def equal(a: Trajectory, b: Trajectory) -> bool:
    fields = ("time_s", "lonlat", "altitude_m", "roll_deg", "pitch_deg", "yaw_deg")
    same = all(np.array_equal(getattr(a, name), getattr(b, name)) for name in fields)
    return same and (a.names, a.weather, a.time_of_day) == (b.names, b.weather, b.time_of_day)


def fault(path: Path, text: str) -> str:
    """Write a file that is at fault and return the message, which names the file."""
    path.write_bytes(text.encode())
    with pytest.raises(CameraError) as caught:
        read_trajectory(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    return message.removeprefix(f"{path}: ")


def csv_fault(tmp_path: Path, *lines: str) -> str:
    return fault(tmp_path / "my.csv", "\n".join(lines) + "\n")


@pytest.mark.parametrize("ending", ["csv", "json"])
@settings(max_examples=40, deadline=None)
@given(flight=flights())
def test_what_is_written_is_read(
    tmp_path_factory: pytest.TempPathFactory, ending: str, flight: Trajectory
) -> None:
    path = tmp_path_factory.mktemp("t") / f"my.{ending}"
    write_trajectory(path, flight)
    read = read_trajectory(path)
    assert equal(read, rounded(flight))
    first = path.read_bytes()
    write_trajectory(path, read)
    assert path.read_bytes() == first


def test_digits_are_those_stated(tmp_path: Path) -> None:
    flight = over_city([1.0], [1.0], [120.123456789])
    write_trajectory(tmp_path / "my.csv", flight)
    cells = (tmp_path / "my.csv").read_text().splitlines()[1].split(",")
    assert cells[3:] == ["120.1235", "0.0", "-45.0", "0.0", "0.0"]
    assert len(cells[1].split(".")[1]) <= 9


def test_no_minus_stands_before_zero(tmp_path: Path) -> None:
    flight = over_city([1.0], [1.0], [-0.00001])
    write_trajectory(tmp_path / "my.csv", flight)
    assert "-0.0," not in (tmp_path / "my.csv").read_text()


def test_a_plain_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "my.CSV"
    # A mark of byte order, blanks, another tool's column, Windows' line ends and an empty line.
    path.write_bytes(
        b"\xef\xbb\xbflongitude, latitude,altitude,roll,pitch,yaw,time,speed\r\n"
        b"113.25,28.2,1.2e2,0,-90,-10,5,fast\r\n\r\n"
        b" 113.5 ,28.25,.5,1,+0,370e-1,6.5,slow\r\n"
    )
    flight = read_trajectory(path)
    assert flight.names == ("000000", "000001")
    assert flight.lonlat.tolist() == [[113.25, 28.2], [113.5, 28.25]]
    assert flight.altitude_m.tolist() == [120.0, 0.5]
    assert flight.pitch_deg.tolist() == [-90.0, 0.0]
    assert flight.yaw_deg.tolist() == [-10.0, 37.0]
    assert flight.roll_deg.tolist() == [0.0, 1.0]
    assert flight.time_s.tolist() == [5.0, 6.5]
    assert flight.weather is None


def test_json_is_read(tmp_path: Path) -> None:
    frame = dict(zip(HEADER.split(","), (113.1, 28.2, 120, 1, -45, 10, 0), strict=True))
    frames = [frame | {"name": "a", "weather": "foggy", "time_of_day": "sunset", "lens": [1, 2]}]
    (tmp_path / "my.json").write_text(json.dumps({"frames": frames, "drone": "x"}))
    flight = read_trajectory(tmp_path / "my.json")
    assert (flight.names, flight.weather, flight.time_of_day) == (("a",), ("foggy",), ("sunset",))
    assert flight.roll_deg.tolist() == [1.0]


def test_a_missing_column_is_named_with_the_nearest(tmp_path: Path) -> None:
    message = csv_fault(tmp_path, HEADER.replace("latitude", "lattitude"), *ROWS)
    assert message.startswith("no column latitude (did you mean 'lattitude'?)")
    message = csv_fault(tmp_path, "longitude,latitude,altitude", "1,2,3")
    assert message.startswith("no column roll, pitch, yaw, time\n")


def test_columns_not_parted_by_commas(tmp_path: Path) -> None:
    message = csv_fault(tmp_path, HEADER.replace(",", ";"), ROWS[0].replace(",", ";"))
    assert message.startswith("its columns are not parted by commas")


def test_a_mistyped_optional_column_is_named(tmp_path: Path) -> None:
    message = csv_fault(tmp_path, HEADER + ",wheather", ROWS[0] + ",sunny")
    assert message.startswith("unknown column 'wheather' (did you mean 'weather'?)")


def test_a_column_twice(tmp_path: Path) -> None:
    message = csv_fault(tmp_path, HEADER + ",yaw", ROWS[0] + ",1")
    assert message.startswith("columns more than once: 1 (yaw)")


@pytest.mark.parametrize("cell", ["abc", "", "nan", "inf", "1e999", "1_0", "１０", "0x1A", "--1"])
def test_cells_that_are_no_numbers_are_named_by_line(tmp_path: Path, cell: str) -> None:
    broken = ROWS[1].replace(",121,", f",{cell},")
    message = csv_fault(tmp_path, HEADER, ROWS[0], broken, ROWS[2])
    assert message.startswith(f"altitude is not a finite number in 1 of 3 (line 3: {cell!r})")


@pytest.mark.parametrize("cell", ["true", "null", '"a"', "NaN", "[1]", "1" + "0" * 400])
def test_json_values_that_are_no_numbers(tmp_path: Path, cell: str) -> None:
    frame = dict(zip(HEADER.split(","), (113.1, 28.2, 120, 1, -45, 10, 0), strict=True))
    text = json.dumps({"frames": [frame]}).replace("120", cell)
    message = fault(tmp_path / "my.json", text)
    assert message.startswith("altitude is not a finite number in 1 of 1 (frames[0]: ")


def test_several_rows_are_counted_and_three_shown(tmp_path: Path) -> None:
    rows = [ROWS[0].replace(",-45,", f",{pitch},") for pitch in (91, -45, -91, 120, 200)]
    message = csv_fault(tmp_path, HEADER, *rows)
    assert message.startswith(
        "pitch is out of bounds in 4 of 5 (first 3: line 2: '91', line 4: '-91', line 5: '120')"
    )


def test_swapped_longitude_and_latitude(tmp_path: Path) -> None:
    header = HEADER.replace("longitude,latitude", "latitude,longitude")
    message = csv_fault(tmp_path, header, *ROWS)
    assert "exchange the two columns" in message
    # Beyond any latitude and longitude alike, the longitude is at fault.
    assert "exchange" not in csv_fault(tmp_path, HEADER, "1113,282,1,0,0,0,0")


@pytest.mark.parametrize("times", [("0", "0"), ("1", "0.5")])
def test_times_must_ascend(tmp_path: Path, times: tuple[str, str]) -> None:
    rows = [ROWS[0][:-1] + time for time in times]
    message = csv_fault(tmp_path, HEADER, *rows)
    assert message.startswith(f"time does not ascend in 1 of 2 (line 3: '{times[1]}')")


@pytest.mark.parametrize("name", ["", "a/b", "../up", ".hidden", "a b", "ä", "x" * 65, "-rf"])
def test_names_that_are_no_names_of_files(tmp_path: Path, name: str) -> None:
    message = csv_fault(tmp_path, HEADER + ",name", f"{ROWS[0]},{name}", f"{ROWS[1]},ok")
    assert message.startswith("name cannot be that of a file in 1 of 2 (line 2")


def test_a_name_with_a_line_end(tmp_path: Path) -> None:
    message = csv_fault(tmp_path, HEADER + ",name", ROWS[0] + ',"a\n"')
    assert message.startswith("name cannot be that of a file in 1 of 1 (line 3: 'a\\n')")


def test_names_twice(tmp_path: Path) -> None:
    rows = [f"{row},{name}" for row, name in zip(ROWS, ("a1", "b", "A1"), strict=True)]
    message = csv_fault(tmp_path, HEADER + ",name", *rows)
    assert message.startswith("name stands more than once in 2 of 3 (line 2: 'a1', line 4: 'A1')")


@pytest.mark.parametrize(("column", "right"), [("weather", "sunny"), ("time_of_day", "sunset")])
def test_unknown_conditions(tmp_path: Path, column: str, right: str) -> None:
    message = csv_fault(tmp_path, f"{HEADER},{column}", f"{ROWS[0]},{right}", f"{ROWS[1]},hail")
    assert message.startswith(f"unknown {column} in 1 of 2 (line 3: 'hail')\n  expected: one of ")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no column longitude"),
        (HEADER + "\n", "holds no frame"),
        (HEADER + "\n\n\n", "holds no frame"),
        (HEADER + "\n1,2\n", "another number of cells than the header's in 1 of 1 (line 2: '2 ce"),
        (HEADER + '\n"1,2,3\n', "line 2 is not CSV"),
        (HEADER + "\n" + "1" * 200_000, "line 2 is not CSV: field larger"),
    ],
)
def test_csv_that_is_none(tmp_path: Path, text: str, said: str) -> None:
    assert fault(tmp_path / "my.csv", text).startswith(said)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "not valid JSON"),
        ("{", "not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ("[1]", 'has no list "frames"'),
        ('{"frame": []}', "has no list \"frames\" (did you mean 'frame'?)"),
        ('{"frames": {}}', 'has no list "frames"'),
        ('{"frames": []}', "holds no frame"),
        ('{"frames": [1, {}]}', "no object in 1 of 2 (frames[0])"),
        ('{"frames": [{}]}', "no column longitude"),
    ],
)
def test_json_that_is_none(tmp_path: Path, text: str, said: str) -> None:
    assert fault(tmp_path / "my.json", text).startswith(said)


def test_json_keys_that_some_frames_lack(tmp_path: Path) -> None:
    frame = dict(zip(HEADER.split(","), (113.1, 28.2, 120, 1, -45, 10, 0), strict=True))
    lacking = {key: value for key, value in frame.items() if key != "yaw"}
    message = fault(tmp_path / "my.json", json.dumps({"frames": [frame, lacking]}))
    assert message.startswith("yaw is missing in 1 of 2 (frames[1])")
    message = fault(tmp_path / "my.json", json.dumps({"frames": [frame, frame | {"name": 3}]}))
    assert message.startswith("name is missing in 1 of 2 (frames[0])")
    message = fault(tmp_path / "my.json", json.dumps({"frames": [frame | {"name": 3}]}))
    assert message.startswith("name is not text in 1 of 1 (frames[0]: 3)")


def test_too_many_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trajectory_files, "_MOST_ROWS", 2)
    assert csv_fault(tmp_path, HEADER, *ROWS).startswith("more than 2 frames")
    frames = json.dumps({"frames": [{}, {}, {}]})
    assert fault(tmp_path / "my.json", frames).startswith("more than 2 frames")


def test_files_that_are_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(CameraError, match="no such trajectory file"):
        read_trajectory(tmp_path / "none.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(CameraError, match="a folder, not a trajectory file"):
        read_trajectory(tmp_path / "folder.csv")
    (tmp_path / "latin.csv").write_bytes(b"\xff\xfe")
    with pytest.raises(CameraError, match="not UTF-8"):
        read_trajectory(tmp_path / "latin.csv")
    for name in ("my.txt", "my"):
        with pytest.raises(CameraError, match="format is not known"):
            read_trajectory(tmp_path / name)
        with pytest.raises(CameraError, match=r"\.csv or \.json"):
            write_trajectory(tmp_path / name, over_city([1.0], [1.0], [1.0]))
    monkeypatch.setattr(trajectory_files, "_LIMIT_BYTES", 10)
    assert csv_fault(tmp_path, HEADER, *ROWS).startswith("too large")
