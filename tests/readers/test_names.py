"""Which id a method's name of an image means."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.readers.names import ImageNames, read_names

NAMES = ImageNames.of(
    "query",
    [
        ("city/a", "a.jpg"),
        ("rural/a", "a.jpg"),
        ("city/b", "b.JPG"),
        ("rural/day/c", "day/c.png"),
        ("rural/night/c", "night/c.png"),
        ("city/1.5", "1.5.jpg"),
    ],
)


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("b.JPG", "city/b"),
        ("b", "city/b"),
        ("b.png", "city/b"),
        ("/data/city/photos/b.JPG", "city/b"),
        ("C:\\data\\city\\a.jpg", "city/a"),
        ("rural/a.jpg", "rural/a"),
        ("/x/rural/images/a.jpg", "rural/a"),
        ("day/c.png", "rural/day/c"),
        ("/x/night/c.png", "rural/night/c"),
        ("1.5.jpg", "city/1.5"),
        ("1.5", "city/1.5"),
        ("z.jpg", None),
        ("other/c.png", None),
        ("", None),
    ],
)
def test_paths_by_hand(path: str, expected: str | None) -> None:
    assert NAMES.find(path) == expected


@pytest.mark.parametrize("path", ["a.jpg", "/x/a.jpg", "c.png"])
def test_what_could_be_several_is_refused(path: str) -> None:
    with pytest.raises(PredictionError, match="could be 2"):
        NAMES.find(path)


def test_two_names_of_one_image_are_refused() -> None:
    with pytest.raises(PredictionError, match=r"'b\.JPG' and 'x/b\.jpg' are both city/b"):
        NAMES.find_all(["b.JPG", "x/b.jpg"], Path("list.txt"))


def test_names_of_nothing_are_refused() -> None:
    with pytest.raises(PredictionError, match="none of its names is that of a query"):
        NAMES.find_all(["x", "y"], Path("list.txt"))
    assert NAMES.find_all(["x", "b"], Path("list.txt")) == [None, "city/b"]


def test_lists_are_read_with_any_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "names.txt"
    path.write_bytes("\ufeffa.jpg\r\n\r\n b.jpg \n".encode())
    assert read_names(path) == ["a.jpg", "b.jpg"]
