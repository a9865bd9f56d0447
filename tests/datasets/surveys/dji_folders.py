"""The made-up survey as a DJI drone with RTK stores it."""

from __future__ import annotations

import io
from pathlib import Path

from PIL import Image

from tests.datasets.surveys.survey import CENTRE, FOCAL, GROUND_M, NAMES, PHOTO, Made
from tests.datasets.xmp import packet


def write_photo(path: Path, values: dict[str, str], altitude: float, film_mm: int | None) -> None:
    """Write a photo with EXIF altitude and DJI's XMP."""
    exif = Image.Exif()
    exif.get_ifd(0x8825).update({5: b"\0", 6: altitude})
    if film_mm is not None:
        exif.get_ifd(0x8769)[0xA405] = film_mm
    attributes = " ".join(f'drone-dji:{key}="{value}"' for key, value in values.items())
    data = b"http://ns.adobe.com/xap/1.0/\0" + packet(attributes)
    stream = io.BytesIO()
    Image.new("L", PHOTO).save(stream, "JPEG", exif=exif)
    content = stream.getvalue()
    head = b"\xff\xe1" + (len(data) + 2).to_bytes(2)
    path.write_bytes(content[:2] + head + data + content[2:])


def dji_folder(
    made: Made,
    *,
    flags: tuple[int | None, ...] = (50,) * 5,
    off_deg: float = 0.0,
    changes: dict[str, str] | None = None,
    without: tuple[str, ...] = (),
    film_mm: int | None = None,
) -> Path:
    """Write photos as a DJI drone with RTK does; 1e-5 degrees are about a metre."""
    folder = made.folder / "DJI_202405"
    folder.mkdir(exist_ok=True)
    cx, cy = CENTRE[0] - PHOTO[0] / 2, CENTRE[1] - PHOTO[1] / 2
    lens = ",".join(f"{v:.9f}" for v in (FOCAL, FOCAL, cx, cy, *made.lens.values()))
    rows = zip(NAMES, made.lonlat, made.centres, made.gimbal(), flags, strict=True)
    for name, (lon, lat), centre, (yaw, pitch, roll), flag in rows:
        values = {
            "GpsLatitude": f"{lat + off_deg:+.9f}",
            "GpsLongitude": f"{lon:+.9f}",
            "AbsoluteAltitude": f"{centre[2]:+.3f}",
            "RelativeAltitude": f"{centre[2] - GROUND_M:+.3f}",
            "GimbalYawDegree": f"{yaw:+.9f}",
            "GimbalPitchDegree": f"{pitch:+.9f}",
            "GimbalRollDegree": f"{roll:+.9f}",
            "RtkFlag": str(flag),
            "RtkStdLon": "0.01000",
            "RtkStdLat": "0.01000",
            "RtkStdHgt": "0.02000",
            "DewarpFlag": "0",
            "DewarpData": f"2024-05-01;{lens}",
        } | (changes or {})
        left = ("RtkFlag", *without) if flag is None else without
        kept = {key: value for key, value in values.items() if key not in left}
        write_photo(folder / name, kept, centre[2], film_mm)
    return folder


def write_time_stamps(
    made: Made, folder: Path, suffixes: bool = True, off_deg: float = 0.0
) -> Path:
    """Write a table of time stamps, as a Matrice 4 does."""
    marks = ("N", "E", "V", "Lat", "Lon", "Ellh", "Q") if suffixes else ("",) * 7
    n, e, v, la, lo, h, q = (f",{mark}" if mark else "" for mark in marks)
    lines = [
        f"{row}\t282401.66{row}089\t[2404]\t   101{n}\t   -17{e}\t   129{v}\t"
        f"{lat + off_deg:.9f}{la}\t{lon:.9f}{lo}\t{centre[2]:.3f}{h}\t0.012, 0.016, 0.030\t50{q}"
        for row, ((lon, lat), centre) in enumerate(zip(made.lonlat, made.centres, strict=True), 1)
    ]
    path = folder / "DJI_202405_Timestamp.MRK"
    path.write_text("\n".join(lines) + "\n")
    return path


def dji_layout(made: Made) -> list[object]:
    return ["dji", "--source", dji_folder(made), *made.maps]


def dji_stamped_layout(made: Made) -> list[object]:
    """Write photos whose own positions are half a metre off, and time stamps that are not."""
    folder = dji_folder(made, off_deg=5e-6, flags=(None,) * 5)
    write_time_stamps(made, folder)
    return ["dji", "--source", folder, *made.maps]
