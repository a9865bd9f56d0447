"""Seeded mutants of the whole package, and which of them the tests kill.

    python -m tests.mutants --count 300 --seed 0 [--only matching --only geometry]

A mutant changes one comparison, operator, constant or condition in a copy of the checkout. It meets
the test files that run the changed statement, in a fork of a process that has imported the
libraries. A first run of each file finds them by probes; files that fail there are left out. A
survivor is printed with its place: it is equivalent, or a test is missing.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import multiprocessing
import os
import random
import shutil
import signal
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "airzoo_bench"
TIMEOUT_S = 300
FILES = 12  # that a mutant meets at most: a line that more run is killed by the first
PAIRS = "Lt LtE, Gt GtE, Eq NotEq, In NotIn, Is IsNot, And Or, Add Sub, Mult Div, USub UAdd"
SWAPS = {
    getattr(ast, one): getattr(ast, other)
    for pair in PAIRS.split(", ")
    for one, other in (pair.split(), pair.split()[::-1])
}


Mutant = tuple[Path, int]
"""A file, and which of its places that can be changed is changed."""


def places(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that can be changed, outside of annotations."""
    if changes_of(node):
        yield node
    for field, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and field not in ("annotation", "returns"):
                yield from places(child)


def changes_of(node: ast.AST) -> dict[str, Any]:
    """Return the fields of a node that a mutant has otherwise; none where it cannot be changed."""
    op = getattr(node, "op", None)
    if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPS:
        return {"ops": [SWAPS[type(node.ops[0])](), *node.ops[1:]]}
    if type(op) in SWAPS:
        return {"op": SWAPS[type(op)]()}
    if isinstance(op, ast.Not):
        return {"operand": ast.UnaryOp(ast.Not(), node.operand)}  # type: ignore[attr-defined]
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        return {"value": not node.value}
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return {"value": node.value + 1}
    return {}


def all_mutants(rooms: list[str]) -> list[Mutant]:
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        room = path.relative_to(PACKAGE).parts[0]
        if not rooms or room in rooms:
            count = len(list(places(ast.parse(path.read_text("utf-8")))))
            found += [(path.relative_to(ROOT), number) for number in range(count)]
    return found


PROBES = """
import os
SEEN = set()
def hit(number):
    test = os.environ.get("PYTEST_CURRENT_TEST", "").partition("::")[0]
    if (number, test) not in SEEN:
        SEEN.add((number, test))
        with open({place!r}, "a") as out:
            out.write(f"{{number}} {{test}}\\n")
"""


def with_probes(source: str, numbers: Mapping[int, int]) -> str:
    """Put a call before the statement of each place; the numbers are the mutants' own."""
    tree = ast.parse(source)
    # Statements come before those within them: the last that holds a node is the innermost.
    blocks = [one for one in ast.walk(tree) if isinstance(one, ast.stmt)]
    home = {id(child): one for one in blocks for child in ast.walk(one)}
    probes = defaultdict[int, list[ast.stmt]](list)
    for place, node in enumerate(places(tree)):
        if place in numbers:
            call = f"__import__('probes').hit({numbers[place]})"
            probes[id(home[id(node)])] += ast.parse(call).body
    for parent in [*ast.walk(tree)]:
        for _, block in ast.iter_fields(parent):
            if isinstance(block, list) and isinstance(next(iter(block), None), ast.stmt):
                block[:] = [one for old in block for one in (*probes[id(old)], old)]
    return ast.unparse(tree)


def probed_checkout(chosen: Sequence[Mutant], copy: Path) -> Path:
    """Copy the checkout with a probe before the statement of each mutant."""
    by_file = defaultdict[Path, dict[int, int]](dict)
    for number, (path, place) in enumerate(chosen):
        by_file[path][place] = number
    copy_checkout(copy)
    for path, numbers in by_file.items():
        (copy / path).write_text(with_probes((ROOT / path).read_text("utf-8"), numbers), "utf-8")
    (copy / "probes.py").write_text(PROBES.format(place=str(copy / "hits")), "utf-8")
    return copy


def find_tests(chosen: Sequence[Mutant], probed: Path, pool: Executor) -> list[list[str]]:
    """Run each test file once; return those that each mutant will meet."""
    files = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "tests").rglob("test_*.py"))
    passed = dict(zip(files, pool.map(partial(do_pass, probed), files), strict=True))
    print("left out:", *(file for file in files if not passed[file]), flush=True)  # noqa: T201
    sound = {file for file in files if passed[file]}
    found: list[set[str]] = [set() for _ in chosen]
    for line in (probed / "hits").read_text("utf-8").splitlines():
        number, _, test = line.partition(" ")
        found[int(number)].add(test)
    return [tests_of(path, met, sound) for (path, _), met in zip(chosen, found, strict=True)]


def tests_of(path: Path, met: set[str], sound: set[str]) -> list[str]:
    """Return the first test files that run a statement, those of its room before the goldens."""
    room = f"tests/{path.parts[1]}/"
    if "" in met:  # it runs at imports, for all tests
        met = met | {file for file in sound if file.startswith(room)}
    near = sorted(
        met & sound, key=lambda test: (not test.startswith(room), "goldens" in test, test)
    )
    return near[:FILES]


def run_tests(copy: Path, tests: Sequence[str]) -> None:
    """Run tests in this process, a fork, and end it with 0 where all pass."""
    os.setsid()
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    os.chdir(copy)
    os.environ.update(PYTHONPATH=str(copy), PYTHONDONTWRITEBYTECODE="1")
    sys.dont_write_bytecode = True
    sys.path[:] = [str(copy), *(place for place in sys.path if place not in ("", str(ROOT)))]
    options = ["-x", "-q", "-p", "no:cacheprovider", "--hypothesis-profile=mutants"]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # of what is imported already
    try:
        code = int(pytest.main([*options, *tests]))
    finally:
        os._exit(code)


def do_pass(copy: Path, *tests: str) -> bool:
    """Return whether all tests pass in a fork of this process, in time."""
    if not (child := os.fork()):
        run_tests(copy, tests)
    signal.signal(signal.SIGALRM, lambda *_: os.killpg(child, signal.SIGKILL))
    signal.alarm(TIMEOUT_S)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    signal.alarm(0)
    return code == 0


def is_killed(job: tuple[Mutant, list[str]], folder: Path) -> tuple[bool, str]:
    """Return whether a test fails on a mutant, and what the changed line was."""
    (path, number), tests = job
    copy = copy_checkout(folder / str(os.getpid()))
    target, source = copy / path, (ROOT / path).read_text("utf-8")
    tree = ast.parse(source)
    node: Any = list(places(tree))[number]
    before = ast.unparse(node)
    for name, value in changes_of(node).items():
        setattr(node, name, value)
    target.write_text(ast.unparse(tree), "utf-8")
    survived = not tests or do_pass(copy, *tests)
    target.write_text(source, "utf-8")
    return not survived, f"{path}:{node.lineno}: {before} -> {ast.unparse(node)}"


def copy_checkout(copy: Path) -> Path:
    """Copy the checkout, once."""
    ignored = shutil.ignore_patterns(".git", ".*_cache", "__pycache__")
    if not copy.exists():
        shutil.copytree(ROOT, copy, symlinks=True, ignore=ignored)
    return copy


def import_libraries() -> None:
    """Import what the package imports, but not the package, of which every mutant is another."""
    for path in sorted(PACKAGE.rglob("*.py")):
        importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    for name in list(sys.modules):
        if name.partition(".")[0] in (PACKAGE.name, "tests"):
            del sys.modules[name]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", action="append", default=[], help="a room, such as matching")
    options = parser.parse_args()
    every = all_mutants(options.only)
    chosen = random.Random(options.seed).sample(every, min(options.count, len(every)))
    killed: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "shared").symlink_to(ROOT.parent / "shared")  # the real scene
        probed = probed_checkout(chosen, folder / "probed")
        import_libraries()
        with ProcessPoolExecutor(options.jobs, multiprocessing.get_context("fork")) as pool:
            jobs = zip(chosen, find_tests(chosen, probed, pool), strict=True)
            work = partial(is_killed, folder=folder)
            for mutant, (dead, text) in zip(chosen, pool.map(work, jobs), strict=True):
                killed[mutant[0].parts[1]] += dead
                print("killed  " if dead else "SURVIVED", text, flush=True)  # noqa: T201
    tried = Counter(path.parts[1] for path, _ in chosen)
    rows = [f"{room}: {killed[room]} of {count} killed" for room, count in sorted(tried.items())]
    print(*rows, f"{killed.total()} of {len(chosen)} killed", sep="\n")  # noqa: T201


if __name__ == "__main__":
    main()
