"""The house of docs/architecture.md: imports point one way, and no room or run grows."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.walk import walk_template

HOME = Path(__file__).parent.parent
PACKAGE = "airzoo_bench"

Imports = Mapping[str, set[str]]


def modules(home: Path) -> dict[str, Path]:
    """Return the files of the package by the names they are imported by."""
    paths = sorted((home / PACKAGE).rglob("*.py"))
    dotted = {path: path.relative_to(home).with_suffix("").parts for path in paths}
    return {".".join(parts).removesuffix(".__init__"): path for path, parts in dotted.items()}


def imports(home: Path) -> Imports:
    """Return what each file imports of the package, within functions too, and not for types."""
    files = modules(home)
    found = {}
    for name, path in files.items():
        named = set(_imported(ast.parse(path.read_text())))
        # `from a.b import c` names the file a.b.c, or else something in a.b.
        found[name] = {one if one in files else one.rpartition(".")[0] for one in named} - {name}
    return found


def _imported(tree: ast.AST) -> Iterator[str]:
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == PACKAGE:
            yield from (f"{node.module}.{one.name}" for one in node.names)
        elif isinstance(node, ast.Import):
            yield from (one.name for one in node.names if one.name.split(".")[0] == PACKAGE)
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
        else:
            below = ast.iter_child_nodes(node)
            waiting += [one for one in below if not isinstance(one, ast.expr)]


def circle(graph: Imports) -> list[str]:
    """Return files that import each other in a circle, the first again at the end; or none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        found: list[str] = error.args[1]
        return found
    return []


def floors() -> dict[str, int]:
    """Return the row of each room in the table of docs/architecture.md."""
    text = (HOME / "docs" / "architecture.md").read_text()
    table = text.partition("| place | what |")[2].partition("\n\n")[0]
    rows = [re.findall(r"`(\w+)/`", row.split("|")[1]) for row in table.splitlines()[2:]]
    return {room: floor for floor, rooms in enumerate(rows) for room in rooms}


def upward(graph: Imports, floor: Mapping[str, int]) -> list[str]:
    """Return the imports of a room from one that is not above it in the table."""
    return [
        f"{name} -> {other}"
        for name, others in graph.items()
        for other in sorted(others)
        if (room := _room(name)) != (from_room := _room(other))
        and room in floor
        and from_room in floor
        and floor[from_room] >= floor[room]
    ]


def _room(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def test_imports_are_no_circle_and_point_up_the_table_which_has_every_room() -> None:
    graph, floor = imports(HOME), floors()
    assert (circle(graph), upward(graph, floor)) == ([], [])
    assert set(floor) == {path.parent.name for path in (HOME / PACKAGE).glob("*/__init__.py")}


def weights(home: Path) -> Counter[str]:
    """Return the lines of Python in each room."""
    found: Counter[str] = Counter()
    for path in (home / PACKAGE).rglob("*.py"):
        parts = path.relative_to(home / PACKAGE).parts
        room = "datasets/mini" if parts[:2] == ("datasets", "mini") else parts[0]
        found[room if len(parts) > 1 else "top"] += len(path.read_text().splitlines())
    return found


def limits() -> dict[str, int]:
    """Return the limit of each room, from the table of docs/architecture.md."""
    text = (HOME / "docs" / "architecture.md").read_text()
    rows = text.partition("| room | limit | aim |")[2].partition("\n\n")[0]
    return {room: int(limit) for room, limit in re.findall(r"`([\w/]+)` \| (\d+) \|", rows)}


def test_no_room_exceeds_its_limit() -> None:
    found, allowed = weights(HOME), limits()
    assert set(found) == set(allowed)
    over = {room: (count, allowed[room]) for room, count in found.items() if count > allowed[room]}
    assert over == {}, "see docs/architecture.md, the weight of each room"


def test_no_test_imports_another_test_file() -> None:
    """Helpers of tests belong into files of their own."""
    named = re.compile(r"^\s*from tests(?:\.\w+)*\.test_\w+ import", re.MULTILINE)
    tests = [*(HOME / "tests").rglob("*.py"), *(HOME / "benchmarks").rglob("*.py")]
    assert [path for path in tests if named.search(path.read_text())] == []


# Files and functions; lower them with each room that is written anew (`python -m tests.walk`).
MOST = {"retrieval": (33, 358), "matching": (40, 400), "reconstruction": (45, 535)}


@pytest.mark.slow
@pytest.mark.parametrize("track", MOST)
def test_a_score_runs_through_no_more_files_than_before(track: str) -> None:
    counts = walk_template(track)
    files, functions = MOST[track]
    assert 0 < counts["files"] <= files
    assert 0 < counts["functions"] <= functions


def test_circles_and_upward_imports_are_seen_within_functions_and_not_among_types(
    tmp_path: Path,
) -> None:
    """In a package of two rooms: `core` has two files, `cli` imports one of them."""
    for name, text in {
        "core/files": "from airzoo_bench.core import errors\n",
        "core/errors": "if TYPE_CHECKING:\n    from airzoo_bench.core.files import x\n",
        "cli/main": "def main():\n    from airzoo_bench.core.files import x\n",
    }.items():
        path = (tmp_path / PACKAGE / name).with_suffix(".py")
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(text)
    floor, errors = {"core": 0, "cli": 1}, tmp_path / PACKAGE / "core" / "errors.py"
    assert circle(imports(tmp_path)) == []
    assert upward(imports(tmp_path), floor) == []
    errors.write_text("class A:\n    def b(self):\n        import airzoo_bench.core.files\n")
    assert set(circle(imports(tmp_path))) == {"airzoo_bench.core.errors", "airzoo_bench.core.files"}
    errors.write_text("from airzoo_bench.cli.main import main\n")
    assert upward(imports(tmp_path), floor) == ["airzoo_bench.core.errors -> airzoo_bench.cli.main"]
