"""Results, published tables, and the sources of own photos."""

from __future__ import annotations

from pathlib import Path

from tests.hostile.inputs.case import Input
from tests.hostile.mutations import spoil_bytes, spoil_text
from tests.support import make_place, run_main

__all__ = ["results", "sources", "tables"]


def results(home: Path, retrieval: Path) -> list[Input]:
    ranked = retrieval / "given" / "ranked.npz"
    for name in ("mine", "theirs"):
        out = home / name
        data = ("--data", retrieval / "data", "--out", out, "--method", name)
        assert run_main("eval", "retrieval", ranked, *data) == 0
    both = ("FOLDER/mine", "FOLDER/theirs")
    cheap = (
        ("compare", *both),
        *(("table", *both, "--format", form) for form in ("latex", "csv", "html", "terminal")),
        ("table", *both, "--intervals"),
        ("breakdown", "FOLDER/mine", "--by", "weather"),
    )
    report = (("report", *both, "--out", "FOLDER/r.html"),)
    made = []
    for file, spoil in (("result.json", spoil_text), ("records.csv", spoil_text)):
        made.append(
            Input(f"results/{file}", home, f"mine/{file}", spoil, cheap, None, 0.7, checksums=True)
        )
        made.append(
            Input(f"report/{file}", home, f"mine/{file}", spoil, report, None, 0.2, checksums=True)
        )
    return made


_LONG = "method,scene,metric,value\n" + "".join(
    f"{m},{s},{k},{v}\n"
    for m, v in (("A", "50.31"), ("B", "61.49"))
    for s in ("City", "Rural")
    for k in ("R@1", "R@5")
)


def tables(home: Path) -> list[Input]:
    home.mkdir()
    (home / "long.csv").write_text(_LONG)
    return [Input("audit/long.csv", home, "long.csv", spoil_text, (("audit", "FILE"),))]


def sources(home: Path) -> list[Input]:
    home.mkdir()
    make_place(home, {"a.jpg": (64.0, 64.0), "b.jpg": (192.0, 64.0)})
    options = {
        "--name": "park",
        "--images": "FOLDER/photos",
        "--poses": "FOLDER/poses.json",
        "--dom": "FOLDER/dom.tif",
        "--dsm": "FOLDER/dsm.tif",
        "--tile-size": "64",
        "--out": "FOLDER/out",
    }
    command = ("prepare", "photos", *(text for pair in options.items() for text in pair))
    return [
        Input("prepare/poses.json", home, "poses.json", spoil_text, (command,), None, 0.15),
        Input("prepare/photo", home, "photos/a.jpg", spoil_bytes, (command,), None, 0.1),
        Input("prepare/dom.tif", home, "dom.tif", spoil_bytes, (command,), None, 0.1),
        Input("prepare/dsm.tif", home, "dsm.tif", spoil_bytes, (command,), None, 0.1),
    ]
