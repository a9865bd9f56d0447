"""Archives that lead elsewhere, unpack to more than they say, or hold what no archive should."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.formats.cloud_support import LIMIT, refused
from tests.reconstruction.listed import listed


@pytest.mark.parametrize(
    "name",
    [
        "../school.ply",
        "/school.ply",
        "a/../../b.ply",
        "a\\b.ply",
        "C:/b.ply",
        "a//b.ply",
        "b\n.ply",
    ],
)
@pytest.mark.parametrize("suffix", [".zip", ".tar"])
def test_names_that_lead_elsewhere(name: str, suffix: str, tmp_path: Path) -> None:
    path = pack_bytes(tmp_path / f"a{suffix}", [(name, b"ply\n")])
    with refused("leads out of it or is no plain path") as caught:
        listed(path)
    assert "\n.ply" not in str(caught.value)


def pack_bytes(path: Path, files: list[tuple[str, bytes]]) -> Path:
    if path.suffix == ".zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as pack:
            for name, content in files:
                info = zipfile.ZipInfo("x")
                info.filename = name
                info.compress_type = zipfile.ZIP_DEFLATED
                pack.writestr(info, content)
        return path
    with tarfile.open(path, "w:gz" if path.suffix == ".tgz" else "w") as tape:
        for name, content in files:
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            tape.addfile(entry, io.BytesIO(content))
    return path


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("suffix", [".zip", ".tar"])
@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a.ply", "a.ply"], "more than once"),
        (["a.ply", "A.ply"], "more than once"),
        (["a.ply", "a.laz"], "two entries: a.laz and a.ply"),
        (["a/x.ply", "a/y.ply", "b.ply"], "two entries"),
        (["a.ply", "b.zip"], "an archive inside"),
        (["a.ply", "b.ply.gz"], "an archive inside"),
        (["a.doc"], "holds no cloud"),
        (["a/b/c.ply", "d/e/f.ply"], "holds no cloud"),
        ([], "holds no cloud"),
    ],
)
def test_wrong_entries(suffix: str, names: list[str], message: str, tmp_path: Path) -> None:
    path = pack_bytes(tmp_path / f"p{suffix}", [(name, b"x") for name in names])
    with refused(message):
        listed(path)


@pytest.mark.parametrize("suffix", [".zip", ".tar", ".tgz"])
def test_bombs_are_refused_before_they_are_unpacked(suffix: str, tmp_path: Path) -> None:
    path = pack_bytes(tmp_path / f"p{suffix}", [("a.ply", bytes(1 << 22)), ("b.ply", bytes(9))])
    with refused("unpacks to 4,194"):
        listed(path, room=1 << 20)


def test_a_zip_that_unpacks_to_more_than_it_says(tmp_path: Path) -> None:
    path = pack_bytes(tmp_path / "p.zip", [("a.ply", bytes(1 << 20))])
    raw = path.read_bytes()
    path.write_bytes(raw.replace((1 << 20).to_bytes(4, "little"), (99).to_bytes(4, "little")))
    predictions = listed(path)
    with (
        refused(r"cannot be unpacked|another size"),
        predictions.opened("a", limit_bytes=LIMIT, sampling=None),
    ):
        pass


def test_links_are_refused(tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "a.tar", "w") as tape:
        for kind in (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE):
            entry = tarfile.TarInfo("a.ply")
            entry.type, entry.linkname = kind, "/etc/passwd"
            tape.addfile(entry)
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as pack:
        info = zipfile.ZipInfo("a.ply")
        info.external_attr = 0o120777 << 16
        pack.writestr(info, "/etc/passwd")
    root = tmp_path / "folder"
    root.mkdir()
    (root / "a.ply").symlink_to("/etc/passwd")
    for path in (tmp_path / "a.tar", tmp_path / "a.zip", root):
        with refused("is a link"):
            listed(path)
