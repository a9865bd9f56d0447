"""Tables of benchmarks: columns by name, separators, encodings.

What are no tables is in tests/goldens/refusals.txt.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.datasets.tables import Table, match_names, read_lines, read_table

COLUMNS = {name: (name,) for name in ("filename", "lat", "height", "Phi1")}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "航线 01.csv"


def read(path: Path, content: str | bytes) -> Table:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_table(path, COLUMNS, ("Phi1",))


@pytest.mark.parametrize(
    "content",
    [
        "num,filename,lat,height\n1,a.JPG,29.5,405\n2,b.JPG,-1e1,406.25\n",
        "\ufeffnum,filename,lat,height\r\n1,a.JPG,29.5,405\r\n2,b.JPG,-10,406.25\r\n",
        "height,Lat , FILENAME\n405, 29.5 ,a.JPG\n\n406.25,-10,b.JPG\n\n",
        'filename\tlat\theight\t\na.JPG\t29.5\t405\t\n"b.JPG"\t-10\t406.25\t\n',
        "filename;lat;height\na.JPG;29.5;405\nb.JPG;-10;406.25\n",
        "filename,地点,lat,height\na.JPG,长江,29.5,405\nb.JPG,,-10,406.25".encode("gb18030"),
    ],
)
def test_columns_by_name(path, content) -> None:
    table = read(path, content)
    assert table.texts("filename") == ("a.JPG", "b.JPG")
    assert len(table) == 2
    np.testing.assert_array_equal(table.numbers("lat"), [29.5, -10.0])
    np.testing.assert_array_equal(table.numbers("height"), [405.0, 406.25])
    assert not table.has("Phi1")


def test_optional_and_further_columns(path: Path) -> None:
    table = read(path, "filename,lat,height,phi1,date\na,1,2,,x\nb,1,2,-3,x\n")
    assert list(table.names) == ["filename", "lat", "height", "phi1", "date"]
    np.testing.assert_array_equal(table.numbers("Phi1", empty=True), [np.nan, -3.0])
    with pytest.raises(BenchmarkError, match=r"line 2: column phi1: ''"):
        table.numbers("Phi1")


def test_names_of_other_programs_mean_photos(path: Path) -> None:
    photos = ["a/DJI_1.JPG", "b/DJI_2.JPG", "b/DJI_3.JPG"]
    given = ["DJI_1", "B\\dji_2.jpg", "b/DJI_3.JPG", "DJI_9"]
    assert match_names(given, photos, "poses.csv") == dict(zip(given[:3], photos, strict=True))
    with pytest.raises(BenchmarkError, match="more than one name"):
        match_names(["DJI_1", "dji_1.jpg"], photos, "poses.csv")
    table = read(path, "filename,lat,height\na,1,2\na,1,2\nb,1,2\n")
    with pytest.raises(BenchmarkError, match="column filename"):
        table.require_unique("filename")


def test_lines_without_a_header(path: Path) -> None:
    path.write_text("# made by hand\n\nDJI 0001.JPG 1 0.5\nb.JPG  2\t-1e-3 \n")
    table = read_lines(path, ("name", "qw", "qx"))
    assert table.texts("name") == ("DJI 0001.JPG", "b.JPG")
    assert list(table.lines) == [3, 4]
    np.testing.assert_array_equal(table.numbers("qx"), [0.5, -1e-3])
    for text in ("a.JPG 1\n", "\n"):
        path.write_text(text)
        with pytest.raises(BenchmarkError, match="line 1"):
            read_lines(path, ("name", "qw", "qx"))
