"""E57: bits across packets, poses, and headers that promise what is not there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.formats.clouds.e57_pages import crc32c
from tests.formats.cloud_support import (
    E57_SCALE,
    colours_of,
    e57_content,
    e57_pages,
    made,
    opened,
    points_of,
    read,
    refused,
    write_e57,
)


@pytest.mark.parametrize("split", [0, 1, 17, 40])
def test_points_are_read_whatever_the_packets(split: int, tmp_path: Path) -> None:
    columns = made()
    cloud = read(write_e57(tmp_path / "a.e57", columns, split))
    np.testing.assert_array_equal(cloud.points[:, 0], columns["x"] + 100.0)
    rounded = np.rint(points_of(columns)[:, 1:] / E57_SCALE) * E57_SCALE
    np.testing.assert_array_equal(cloud.points[:, 1:], rounded)
    np.testing.assert_array_equal(cloud.colours, colours_of(columns))
    assert opened(tmp_path / "a.e57").notes == ("1 scan, each at its pose",)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b'recordCount="40"', b'recordCount="41"', "1 point before its count"),
        (b'recordCount="40"', b'recordCount="4000000000000"', "has no room for"),
        (b'recordCount="40"', b'recordCount="-4"', "XML text is none"),
        (b'fileOffset="48"', b'fileOffset="999999"', "lies beyond its end"),
        (b'fileOffset="48"', b'fileOffset="49"', "damaged"),
        (b"cartesianX", b"sphereAzim", "lack cartesianX"),
        (b'type="ScaledInteger"', b'type="String"       ', "XML text is none"),
        (b'scale="0.0009765625"', b'scale="nan"         ', "XML text is none"),
        (b"<data3D", b"<!DOCTY", "declares"),
        (b"<data3D", b"<data3E", "XML text is none"),
        (b"ASTM-E57\1", b"ASTM-E57\2", "version 1"),
    ],
)
def test_damage_is_refused(old: bytes, new: bytes, message: str, tmp_path: Path) -> None:
    content = write_e57(tmp_path / "a.e57", made()).read_bytes()
    logical = e57_content(content)
    assert old in logical
    changed = logical.replace(old, new)
    if len(new) != len(old):
        xml = int.from_bytes(content[32:40], "little") + len(new) - len(old)
        changed = changed[:32] + xml.to_bytes(8, "little") + changed[40:]
        changed = changed[: -(len(new) - len(old))] if len(new) > len(old) else changed + b"\0" * 9
    (tmp_path / "a.e57").write_bytes(e57_pages(changed))
    with refused(message):
        read(tmp_path / "a.e57")


def test_a_checksum_by_hand() -> None:
    """RFC 3720, appendix B.4: 32 bytes of zeros, of ones, and 0 to 31."""
    rows = np.array([[0] * 32, [255] * 32, range(32)], np.uint8)
    assert crc32c(rows).tolist() == [0x8A9136AA, 0x62A8AB43, 0x46DD794E]


@pytest.mark.parametrize("place", [100, 1021, 1500])
def test_a_page_whose_bits_have_turned_is_refused(place: int, tmp_path: Path) -> None:
    path = write_e57(tmp_path / "a.e57", made())
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(bytes(content))
    with refused(f"page {place // 1024 + 1} does not have its checksum"):
        read(path)


def test_a_scan_without_points_has_none(tmp_path: Path) -> None:
    columns = {name: column[:0] for name, column in made().items()}
    assert len(read(write_e57(tmp_path / "a.e57", columns))) == 0


def test_as_libe57format_writes_and_reads(tmp_path: Path) -> None:
    pye57 = pytest.importorskip("pye57", reason="pye57 is not installed")
    random = np.random.default_rng(0)
    count = 20_000  # many packets
    scan = {f"cartesian{axis}": random.random(count) * 100.0 for axis in "XYZ"}
    for name in ("Red", "Green", "Blue"):
        scan[f"color{name}"] = random.integers(0, 256, count).astype(np.uint8)
    turn = np.array([np.cos(0.3), 0.0, 0.0, np.sin(0.3)])
    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    file.write_scan_raw(scan, rotation=turn, translation=np.array([1.0, 2.0, 3.0]))
    file.write_scan_raw({name: column[:777] for name, column in scan.items()})
    file.close()
    file = pye57.E57(str(tmp_path / "a.e57"))
    scans = [file.read_scan(one, ignore_missing_fields=True, colors=True) for one in (0, 1)]
    cloud = read(tmp_path / "a.e57", 999)
    theirs = np.concatenate([np.stack([s[f"cartesian{a}"] for a in "XYZ"], -1) for s in scans])
    np.testing.assert_allclose(cloud.points, theirs, rtol=0.0, atol=1e-12)
    colours = [np.stack([s[f"color{c}"] for c in ("Red", "Green", "Blue")], -1) for s in scans]
    np.testing.assert_array_equal(cloud.colours, np.concatenate(colours))
