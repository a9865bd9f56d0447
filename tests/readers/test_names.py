"""Which id a method's name of an image means."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.readers.names import ImageNames, read_names

NAMES = ImageNames(
    "query",
    [
        ("city/a", "a.jpg"),
        ("rural/a", "a.jpg"),
        ("city/b", "b.JPG"),
        ("city/g", "g.JPG"),
        ("rural/day/c", "day/c.png"),
        ("rural/night/c", "night/c.png"),
        ("city/1.5", "1.5.jpg"),
        ("city/north-2/d", "north-2/d.jpg"),
    ],
    left_out=[("rural/e", "e.jpg"), ("city/east/b", "east/b.jpg"), ("city/f", "f.jpg")],
    scenes=["coast", "city"],
)


MEANT = {
    "city/g": ("g.JPG", "g", "g.png"),
    "city/b": ("/data/city/photos/b.JPG",),
    "city/a": ("C:\\data\\city\\a.jpg", "/rural/exports/city/a.jpg"),
    "rural/a": ("rural/a.jpg", "/x/rural/images/a.jpg"),
    "rural/day/c": ("day/c.png",),
    "rural/night/c": ("/x/night/c.png",),
    "city/1.5": ("1.5.jpg", "1.5", "/coast/exports/city/1.5.jpg"),
    "city/north-2/d": ("north-2/d.jpg",),
    None: (
        *("z.jpg", "other/c.png", "rural/b.JPG", "C:\\data\\rural\\b.JPG", "/data/coast/1.5.jpg"),
        *("/city/exports/coast/1.5.jpg", "/data/city/photos/day/c.png", "city/e.jpg", "e.jpg"),
        *("/data/city/photos/east/b.JPG", "f.jpg", "rural/f.jpg", "/data/rural/north-2/d.jpg", ""),
    ),
}


@pytest.mark.parametrize(
    ("path", "expected"), [(path, one) for one, paths in MEANT.items() for path in paths]
)
def test_paths_by_hand(path, expected) -> None:
    assert NAMES.find(path) == expected


@pytest.mark.parametrize("path", ["a.jpg", "/x/a.jpg", "c.png", "b.JPG"])
def test_what_could_be_several_is_refused(path: str) -> None:
    with pytest.raises(PredictionError, match="could be 2"):
        NAMES.find(path)


def test_names_with_other_separators_name_scenes_too() -> None:
    known = ImageNames(
        "query",
        [("s-1/a", "a.jpg"), ("s-1/b-c", "b-c.jpg"), ("s-2/a", "a.jpg")],
        scenes=["1"],
        change=lambda name: name.replace("-", "/"),
    )
    assert known.find("photos/s/1/a.jpg") == "s-1/a"
    assert known.find("photos/s/2/b/c.jpg") is None
    assert known.find("photos/1/b/c.jpg") is None
    assert known.find("photos/b/c.jpg") == "s-1/b-c"


def test_names_of_nothing_are_refused() -> None:
    left = ImageNames("query", [("s/a/b", "a/b.jpg")], left_out=[("s/c", "c.jpg")])
    with pytest.raises(PredictionError, match="names such as s/a/b"):
        left.find_all(["c.jpg"], Path("list.txt"))
    assert NAMES.find_all(["x", "g"], Path("list.txt")) == [None, "city/g"]


_WORDS = st.sampled_from(["a", "b", "s", "t", "a.jpg", "b.PNG", "a.b.tif", ".jpg", "jpg"])
_PATHS = st.lists(_WORDS | st.sampled_from(["", ".", " "]), max_size=4).flatmap(
    lambda parts: st.sampled_from(["/", "\\"]).map(lambda slash: slash.join(parts))
)


def _parts(text: str) -> list[str]:
    found = [part for part in re.split(r"[/\\]", text.strip()) if part not in ("", ".")]
    return [*found[:-1], re.sub(r"(?i)\.(jpg|png|tif)$", "", found[-1])] if found else []


def _by_hand(known: list[tuple[str, str]], path: str) -> list[str]:
    """Return what a path may mean: names that it ends with, or that end with it.

    The last folder before what the two share that is called as a scene must be the image's.
    """
    asked, scenes = _parts(path), {one[0] for one, _ in known}
    by_scene: dict[bool, list[str]] = {True: [], False: []}
    for one, name in ((one, _parts(name)) for one, name in known):
        length = min(len(name), len(asked))
        if length and name[-length:] == asked[-length:]:
            said = [part for part in asked[: len(asked) - length] if part in scenes]
            if not said or said[-1] == one[0]:
                by_scene[bool(said)].append(one)
    return by_scene[True] or by_scene[False]


@given(st.lists(st.lists(_WORDS, min_size=1, max_size=3).map("/".join), unique=True), _PATHS)
def test_a_path_means_what_it_ends_with(names, path) -> None:
    known = [(f"{'st'[number % 2]}/{number}", name) for number, name in enumerate(names)]
    expected = _by_hand(known, path)
    if len(expected) < 2:
        assert ImageNames("tile", known).find(path) == (expected[0] if expected else None)
        return
    try:
        found = ImageNames("tile", known).find(path)
    except PredictionError as error:
        found = next((one for one in expected if one in str(error)), None)
    assert found in expected


def test_lists_are_read_with_any_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "names.txt"
    path.write_bytes("\ufeffa.jpg\r\n\r\n b.jpg \n".encode())
    assert read_names(path) == ["a.jpg", "b.jpg"]
