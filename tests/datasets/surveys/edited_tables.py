"""Tables of poses of the made-up survey, and its photos, changed as people change them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from tests.datasets.surveys.pose_tables import (
    exact,
    write_table,
)
from tests.datasets.surveys.survey import NAMES, Made

GIMBAL = "image,longitude,latitude,altitude,GimbalYawDegree,GimbalPitchDegree,GimbalRollDegree"


def edited(arguments: list[object], *changes: tuple[str, str]) -> list[object]:
    """Change the text of the table."""
    path = Path(str(arguments[2]))
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return arguments


def radians(made: Made) -> list[object]:
    rows = exact(made.lonlat, made.centres[:, 2], np.radians(made.gimbal()))
    return write_table(made, GIMBAL, rows)


def with_film(made: Made, focal_mm: int) -> None:
    for name in NAMES:
        with Image.open(made.images / name) as image:
            exif = image.getexif()
            exif.get_ifd(0x8769)[0xA405] = focal_mm
            image.save(made.images / name, "JPEG", exif=exif)
