"""AirZoo-Real as it should not be, and what `prepare` says of it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

from tests.datasets.published.changsha import write_map

SCHOOL = "airzoo_real_recon/xuexiao/06-08"


def _edit(name: str, old: str, new: str) -> Callable[[Path], object]:
    def edit(tree: Path) -> None:
        text = (tree / name).read_text()
        assert old in text
        (tree / name).write_text(text.replace(old, new))

    return edit


def _no_photos(tree: Path) -> None:
    for path in (tree / "Scene1").glob("*.JPG"):
        path.unlink()


def _archive(tree: Path) -> None:
    shutil.rmtree(tree / SCHOOL / "images")
    (tree / SCHOOL / "images.zip").write_bytes(b"PK")


SPOILED: dict[str, tuple[Callable[[Path], object], str, list[str]]] = {
    "two maps": (
        lambda t: write_map(t / "Scene1" / "b.tif", 1.0),
        "City",
        ["map (DOM) is not clear", "DOM.tif", "b.tif", "--dom City=FILE"],
    ),
    "no surface": (
        lambda t: (t / "Scene1" / "dsm.tif").rename(t / "Scene1" / "dsm.tif.part"),
        "City",
        ["surface model is not clear", "unfinished download, dsm.tif.part"],
    ),
    "no photos": (
        _no_photos,
        "City",
        ["holds no photo"],
    ),
    "a table that is none": (
        _edit("Scene1/DJI_001_Timestamp.MRK", " 190,V", ""),
        "City",
        ["Timestamp.MRK", "line 1"],
    ),
    "no poses": (
        lambda t: (t / SCHOOL / "poses/poses/t_pose.txt").unlink(),
        "school-06-08",
        ["lacks t_pose.txt"],
    ),
    "an archive": (
        _archive,
        "school-06-08",
        ["lacks images", "images.zip: unpack it"],
    ),
    "photos missing": (
        lambda t: (t / SCHOOL / "images/3_0.png").unlink(),
        "school-06-08",
        ["photos of its poses are missing", "1 of 8 (3)"],
    ),
    "another size": (
        _edit(f"{SCHOOL}/poses/intrinsics/t_intrinsic.txt", "160 120", "160 160"),
        "school-06-08",
        ["another shape than the images"],
    ),
    "no surface of the sites": (
        lambda t: (t / "airzoo_real_recon/dom/fcw_hangtian_DSM.tif").unlink(),
        "school-06-08",
        ["no dom/fcw_hangtian_DSM.tif", "--cloud SCENE=FILE"],
    ),
}
