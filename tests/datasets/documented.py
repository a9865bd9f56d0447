"""The lists of docs/benchmark-folder.md that are made from the code; run this to write them anew.

python -m tests.datasets.documented
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from airzoo_bench.datasets.plausibility import Kind

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "benchmark-folder.md"

# Where `prepare photos` refuses, by what is at fault.
REFUSING = {
    "Folders, names and the CRS of the poses": ["datasets/sources", "geometry/crs"],
    "Photos and their metadata": ["formats/photos", "benchmark/images", "datasets/dji"],
    "Cameras and poses": [
        *("datasets/poses", "geometry/cameras", "geometry/rotations", "geometry/poses"),
        "geometry/units",
    ],
    "Heights": ["geometry/vertical", "datasets/height_systems"],
    "Priors": ["datasets/priors", "matching/prepare"],
    "Map and surface model": [
        *("geometry/rasters", "geometry/colours", "datasets/raster_checks", "datasets/map_facts"),
        "retrieval/gallery",
    ],
    "Cloud": ["datasets/cloud_checks"],
    "All together": [
        *("datasets/photos", "datasets/photos_dataset", "datasets/scene_content"),
        *("datasets/native_prepare", "datasets/scene_additions"),
    ],
}
# Which argument of a function that refuses is the message.
MESSAGE = {"refuse_cameras": 1, "_refuse_names": 1, "_refuse": 2}
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


def parts(page: str, name: str) -> tuple[str, str, str]:
    """Split a page into what stands before, in and after a list."""
    marker = f"<!-- {name}: made by tests/datasets/documented.py -->\n"
    before, rest = page.split(marker)
    inside, after = rest.split("<!-- end -->", 1)
    return before + marker, inside, "<!-- end -->" + after


def main() -> None:
    """Write the lists anew."""
    for name, made in lists().items():
        before, _, after = parts(PAGE.read_text(encoding="utf-8"), name)
        PAGE.write_text(before + made + after, encoding="utf-8")


if __name__ == "__main__":
    main()
