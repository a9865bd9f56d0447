"""Sources of `prepare photos` that are wrong."""

from __future__ import annotations

import json
from collections.abc import Callable

from PIL import Image

from tests.support import Place


def turned(place: Place) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.new("RGB", (64, 48)).save(place.images / "a.jpg", exif=exif)


def renamed(place: Place) -> None:
    names = {f"IMG_{i}.jpg": image for i, image in enumerate(place.read_poses()["images"].values())}
    place.change_poses(images=names)


def unseen(place: Place) -> None:
    for name, (x, y) in place.centres.items():
        place.change_image(name, center=[x, y, 200.0])


def swapped(place: Place) -> dict[str, object]:
    return {"dom": place.dsm, "dsm": place.dom}


def no_poses_key(place: Place) -> None:
    content = place.read_poses()
    del content["images"]["b.jpg"]["R_w2c"]
    place.poses.write_text(json.dumps(content))


def no_crs(place: Place) -> None:
    content = place.read_poses()
    del content["crs"]
    place.poses.write_text(json.dumps(content))


def control_name(place: Place) -> None:
    (place.images / "a.jpg").rename(place.images / "a\x1b[2J.jpg")
    content = json.loads(place.poses.read_text())
    content["images"]["a\x1b[2J.jpg"] = content["images"].pop("a.jpg")
    place.poses.write_text(json.dumps(content))


def empty_colmap(place: Place) -> dict[str, object]:
    folder = place.poses.parent / "model"
    folder.mkdir()
    for name in ("cameras", "images", "points3D"):
        (folder / f"{name}.txt").write_text("# empty\n")
    return {"poses": folder}


def broken_colmap(place: Place) -> dict[str, object]:
    folder = place.poses.parent / "model"
    folder.mkdir()
    (folder / "cameras.bin").write_bytes(b"\x01")
    return {"poses": folder}


def over_the_sources(place: Place) -> dict[str, object]:
    (place.images.parent / "benchmark.toml").write_text("")
    return {"out": place.images.parent, "force": ""}


def options(**changes: object) -> Callable[[Place], dict[str, object]]:
    return lambda place: changes


def resolution(place: Place) -> dict[str, object]:
    from airzoo_bench.protocol.lookup import shipped_protocols

    text = shipped_protocols()["photos-retrieval"].read_text()
    path = place.poses.parent / "fine.toml"
    path.write_text(text.replace('gsd_m = "any"', "gsd_m = 0.3"))
    return {"protocol": path}
