"""The parts of the docs that are made from what datasets say; run this to write them anew.

python -m tests.datasets.documented
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.plausibility import Kind
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.protocol.model import Protocol

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "benchmark-folder.md"
BENCHMARKS = ROOT / "docs" / "benchmarks.md"

# Where `prepare photos` refuses, by what is at fault.
REFUSING = {
    "Folders, names and the CRS of the poses": ["datasets/sources", "geometry/crs"],
    "Photos and their metadata": ["formats/photos", "benchmark/images", "datasets/photo_metadata"],
    "Cameras and poses": [
        *(
            "datasets/poses",
            "datasets/posed_photos",
            "geometry/cameras",
            "geometry/rotations",
            "geometry/poses",
        ),
        "geometry/units",
    ],
    "Heights": ["geometry/vertical", "datasets/height_systems"],
    "Priors": ["datasets/priors", "matching/prepare"],
    "Map and surface model": [
        *("geometry/rasters", "geometry/raster_files", "geometry/colours"),
        *("datasets/raster_checks", "datasets/map_facts"),
        "retrieval/gallery",
    ],
    "Cloud": ["datasets/cloud_checks"],
    "All together": [
        *("datasets/photos", "datasets/photos_dataset", "datasets/scene_content"),
        *("datasets/native_prepare", "datasets/scene_run"),
        "datasets/scene_tasks",
    ],
}
# Which argument of a function that refuses is the message.
MESSAGE = {"refuse_cameras": 1, "_refuse_names": 1, "_refuse": 2, "unseen": 0, "only_run": 1}
# Of calls that `prepare photos` does not make.
INTERNAL = ("shape", "window", "inset", "quaternion")


def text_of(node: ast.expr | None) -> str:
    """Return a message as the code has it, values as an ellipsis."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=parts):
            return "".join(text_of(part) for part in parts)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return text_of(left) + text_of(right)
        case _:
            return "…"


def refusals(module: str) -> Iterator[str]:
    """Yield a line for each fault of the user that a module raises, in the order of its lines."""
    tree = ast.parse((ROOT / "airzoo_bench" / f"{module}.py").read_text())
    calls = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args
        if node.func.id.endswith("Error") or node.func.id in MESSAGE
        if node.func.id != "ValueError"
    ]
    for call in sorted(calls, key=lambda node: node.lineno):
        assert isinstance(call.func, ast.Name)
        what = text_of(call.args[MESSAGE.get(call.func.id, 0)])
        fixes = [text_of(given.value) for given in call.keywords if given.arg == "fix"]
        fix = next((text for text in fixes if text.strip("… ")), "")
        if sum(map(str.isalpha, what)) > 2 and not any(word in what for word in INTERNAL):
            yield f"- {what}" + f". To fix: {fix}" * bool(fix)


def lists() -> dict[str, str]:
    """Return what stands in the page between each marker and the end."""
    groups = (
        f"{title}:\n\n" + "".join(f"{line}\n" for name in modules for line in refusals(name))
        for title, modules in REFUSING.items()
    )
    return {
        "warnings": "".join(f"- {kind.value}\n" for kind in Kind),
        "refusals": "\n".join(groups),
    }


def benchmarks() -> dict[str, str]:
    """Return the parts of docs/benchmarks.md, by their markers."""
    datasets = {name: DATASETS.get(name) for name in DATASETS.names()}
    described = {name: one for name, one in datasets.items() if getattr(one, "about", None)}
    published = {name: one for name, one in described.items() if protocols_of(name)}
    rows = "".join(overview_row(name, one) for name, one in published.items())
    title = "| benchmark | track | scenes | queries | protocol |\n| --- | --- | --- | --- | --- |\n"
    about = {f"about {name}": about_lines(one) for name, one in described.items()}
    return {"overview": f"\n{title}{rows}\n", **about}


def protocols_of(name: str) -> list[Protocol]:
    """Return the shipped protocols of a benchmark."""
    every = (load_protocol(path) for path in shipped_protocols().values())
    return [protocol for protocol in every if protocol.benchmark == name]


def overview_row(name: str, dataset: Any) -> str:
    """Return the rows of a benchmark, one for each of its protocols."""
    rows = []
    for number, protocol in enumerate(protocols_of(name)):
        counts = [scene.queries for scene in protocol.scenes if scene.queries is not None]
        title = dataset.about.title if number == 0 else ""
        queries = f"{sum(counts):,}" if counts else ""
        rows.append(
            f"| {title} | {protocol.track} | {len(protocol.scenes)} | {queries} "
            f"| {protocol.name} |\n"
        )
    return "".join(rows)


def about_lines(dataset: Any) -> str:
    """Return what a dataset says of itself, as lists."""
    about = dataset.about
    own = about.page.startswith("docs/")
    where = [] if own else [f"<{about.page}>"]
    if about.repository:
        where.append(f"`airzoo-bench download {dataset.example.split()[0]}`")
    lines = [f"- Where: {', '.join(where)}"] * bool(where)
    lines += [f"- Licence: {about.licence}"] * (not own)
    lines.append(f"- Command: `airzoo-bench prepare {dataset.example}`")
    for title, sentences in (("Assumed", about.assumptions), ("Not verified", about.unverified)):
        if sentences:
            lines += [f"- {title}:", *(f"  - {sentence}" for sentence in sentences)]
    return "\n" + "\n".join(lines) + "\n\n"


def parts(page: str, name: str) -> tuple[str, str, str]:
    """Split a page into what stands before, in and after a list."""
    marker = f"<!-- {name}: made by tests/datasets/documented.py -->\n"
    before, rest = page.split(marker)
    inside, after = rest.split("<!-- end -->", 1)
    return before + marker, inside, "<!-- end -->" + after


def main() -> None:
    """Write the lists anew."""
    for page, found in ((PAGE, lists()), (BENCHMARKS, benchmarks())):
        for name, made in found.items():
            before, _, after = parts(page.read_text(encoding="utf-8"), name)
            page.write_text(before + made + after, encoding="utf-8")


if __name__ == "__main__":
    main()
