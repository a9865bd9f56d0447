"""University-1652, SUES-200, DenseUAV and GTA-UAV in small, in exactly the layout of each."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

from PIL import Image

__all__ = [
    "CHINESE",
    "TREES",
    "denseuav",
    "gta_uav",
    "picture",
    "sues_200",
    "sues_200_split",
    "university_1652",
]

TESTED, GALLERY = range(701, 709), range(701, 713)
HEIGHTS = ("150", "200", "250", "300")
TRAINED = (1, 2, 3)  # of SUES-200's training split
TESTED_PLACES = (8, 12)  # two of its 80
_FORMATS = {".jpg": "JPEG", ".jpeg": "JPEG", ".JPG": "JPEG", ".png": "PNG", ".tif": "TIFF"}


def picture(path: Path, shade: int = 100) -> None:
    """Write a picture of 8 x 6 px."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(_bytes(_FORMATS[path.suffix], shade % 256))


_CACHE: dict[tuple[str, int], bytes] = {}


def _bytes(kind: str, shade: int) -> bytes:
    if (kind, shade) not in _CACHE:
        stream = io.BytesIO()
        Image.new("RGB", (8, 6), (shade, 255 - shade, 90)).save(stream, kind)
        _CACHE[kind, shade] = stream.getvalue()
    return _CACHE[kind, shade]


def university_1652(folder: Path) -> Path:
    """Write 8 buildings to ask for, 12 in the galleries: 3 drone images of each, 1 satellite."""
    endings = (".jpeg", ".JPG", ".png")
    for name, labels in (("query", TESTED), ("gallery", GALLERY)):
        for label in labels:
            home = folder / "test" / f"{name}_drone" / f"{label:04d}"
            for number, ending in enumerate(endings, start=1):
                picture(home / f"image-{number:02d}{ending}", label)
            home = folder / "test" / f"{name}_satellite" / f"{label:04d}"
            picture(home / f"{label:04d}.jpg", label)
            picture(folder / "test" / f"{name}_street" / f"{label:04d}" / "1.jpg", label)
    picture(folder / "train" / "drone" / "0001" / "image-01.jpeg")
    (folder / "readme.txt").write_text("University-1652\n", encoding="utf-8")
    return folder


def sues_200(folder: Path) -> Path:
    """Write all 200 places at four heights as downloaded, with 1 drone image a height."""
    for label in range(1, 201):
        picture(folder / "satellite-view" / f"{label:04d}" / "0.png", label)
        for height in HEIGHTS:
            home = folder / "drone_view_512" / f"{label:04d}" / height
            picture(home / "0.jpg", label)
    return folder


def sues_200_split(folder: Path, heights: tuple[str, ...] = HEIGHTS) -> Path:
    """Write a few places as the split script leaves them."""
    for height in heights:
        home = folder / "Testing" / height
        for role, labels in (("query", TESTED_PLACES), ("gallery", (*TRAINED, *TESTED_PLACES))):
            for label in labels:
                picture(home / f"{role}_satellite" / f"{label:04d}" / "0.png", label)
                for number in range(2):
                    picture(home / f"{role}_drone" / f"{label:04d}" / f"{number}.jpg", label)
    return folder


def denseuav(folder: Path) -> Path:
    """Write 3 places to ask for and 5 in the galleries, some 20 m from each other."""
    lines = []
    for role, labels in (("query", (2257, 2258, 2259)), ("gallery", range(2255, 2260))):
        for label in labels:
            for height in (80, 90, 100):
                place = f"{label:06d}/H{height}"
                picture(folder / "test" / f"{role}_drone" / f"{place}.JPG", label)
                for ending in (".tif", "_old.tif"):
                    picture(folder / "test" / f"{role}_satellite" / f"{place}{ending}", label)
                if role == "gallery":
                    lon, lat = 120.387 + (label - 2255) * 2e-4, 30.324
                    lines.append(f"test/gallery_drone/{place}.JPG E{lon:.7f} N{lat:.7f} {height}.2")
    (folder / "Dense_GPS_ALL.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    picture(folder / "train" / "drone" / "000001" / "H80.JPG")
    return folder


def centre(name: str) -> list[float]:
    """Where GTA-UAV's own lists have a tile of offset 0, to the tenth of a millimetre."""
    zoom, _, x, y = map(int, name.removesuffix(".png").split("_"))
    side = 24576 / 2**zoom * 0.45
    return [round(side * (x + 0.5), 4), round(side * (y + 0.5), 4)]


def entry(name: str, positive: list[str], near: list[str]) -> dict[str, object]:
    """Make an entry of a list of GTA-UAV; the image is in the middle of its first tile."""
    every = [*positive, *near]
    weights = [0.6 - 0.1 * number for number in range(len(every))]
    found: dict[str, object] = {
        "drone_img_dir": "drone/images",
        "drone_img_name": name,
        "drone_loc_x_y": [axis + 30.0 for axis in centre(every[0])],
        "sate_img_dir": "satellite",
    }
    for kind, tiles in (("pos", positive), ("pos_semipos", every)):
        found[f"pair_{kind}_sate_img_list"] = tiles
        found[f"pair_{kind}_sate_weight_list"] = weights[: len(tiles)]
        found[f"pair_{kind}_sate_loc_x_y_list"] = [centre(tile) for tile in tiles]
    found["drone_metadata"] = {"height": 494.70794677734375, "drone_yaw": 84.99999237060547}
    return found


def gta_uav(folder: Path) -> Path:
    """Write 16 tiles of zoom 4 and 5; 4 images to ask for, one without a positive tile."""
    tiles = [f"{zoom}_0_{x}_{y}.png" for zoom in (4, 5) for x in (6, 7) for y in range(12, 16)]
    for number, tile in enumerate(tiles):
        picture(folder / "satellite" / tile, 10 * number)
    entries = [
        entry("500_0001_0000025682.png", ["4_0_6_13.png"], ["5_0_6_12.png", "5_0_7_13.png"]),
        entry("500_0001_0000025683.png", ["4_0_6_12.png", "4_0_6_13.png"], []),
        entry("200_0002_0000000001.png", ["5_0_7_15.png"], ["4_0_7_12.png"]),
        entry("200_0002_0000000002.png", [], ["4_0_7_12.png"]),
    ]
    for area in ("cross-area", "same-area"):
        for part in ("train", "test"):
            text = json.dumps(entries if area == "cross-area" else entries[:3])
            (folder / f"{area}-drone2sate-{part}.json").write_text(text, encoding="utf-8")
    for one in entries:
        picture(folder / "drone" / "images" / str(one["drone_img_name"]))
    return folder


TREES: dict[str, Callable[[Path], Path]] = {
    "university-1652": university_1652,
    "sues-200": sues_200_split,
    "denseuav": denseuav,
    "gta-uav": gta_uav,
}
CHINESE = "无人机 数据 set"
"""A folder that is not called in ASCII, nor without spaces."""
