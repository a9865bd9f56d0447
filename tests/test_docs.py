"""Pages: each is reached from the README; links, commands and tests that they name exist."""

from __future__ import annotations

import ast
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from airzoo_bench.cli.main import app

HOME = Path(__file__).parent.parent
FOLDERS = ("docs", "examples", "benchmarks")
PAGES = sorted(page for folder in FOLDERS for page in (HOME / folder).rglob("*.md"))
PAGES += [HOME / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
PROTOCOLS = HOME / "docs" / "protocols.md"


def name_of(page: Path) -> str:
    return page.relative_to(HOME).as_posix()


def split(text: str) -> tuple[str, list[str]]:
    """Return the prose of a page, and its blocks of code."""
    block = re.compile(r"^[ ]*```[^\n]*\n(.*?)^[ ]*```", re.MULTILINE | re.DOTALL)
    return block.sub("", text), block.findall(text)


def links(text: str) -> list[str]:
    """Return what links and pictures of a page lead to, addresses of the web aside."""
    found = re.findall(r"\]\(([^)\s]+)\)", split(text)[0])
    return [link for link in found if not re.match(r"\w+:", link)]


def anchors(text: str) -> set[str]:
    """Return the names of the headings of a page, as GitHub makes them."""
    heads = re.findall(r"^#+ (.*)$", split(text)[0], re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def dead(page: Path) -> list[str]:
    """Return the links of a page that lead to no file, or to no heading of it."""
    found = []
    for link in links(page.read_text(encoding="utf-8")):
        file, _, anchor = link.partition("#")
        target = page.parent / (file or page.name)
        if not target.exists() or (anchor and anchor not in anchors(target.read_text("utf-8"))):
            found.append(link)
    return found


def calls(text: str) -> Iterator[list[str]]:
    """Yield the words behind `airzoo-bench` in the code and the prose of a page."""
    prose, blocks = split(text)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    for line in lines:
        for call in re.findall(
            r"(?:^\s*(?:\$ )?|&& )(?:\S*/)?airzoo-bench ([a-z-][^;&|>#\n]+)", line
        ):
            yield call.split() if call.count("'") % 2 or call.count('"') % 2 else shlex.split(call)
    for call in re.findall(r"`airzoo-bench\s([^`|>]+)`", prose):
        yield shlex.split(call)


def unknown(words: list[str], command: Any) -> list[str]:
    """Return a command that there is not, or else its options that there are not."""
    rest = list(words)
    while hasattr(command, "get_command") and rest and rest[0][0] != "-":
        if not rest[0].islower():  # stands for a name
            return []
        found = command.get_command(typer.Context(command), rest[0])
        if found is None:
            return rest[:1]
        command, rest = found, rest[1:]
    known = {option for one in command.params for option in (*one.opts, *one.secondary_opts)}
    given = [word.partition("=")[0] for word in rest if re.match(r"--?[a-zA-Z]", word)]
    return [option for option in given if option not in known | {"--help"}]


@pytest.fixture(scope="module")
def command() -> Any:
    return typer.main.get_command(app)


def test_every_page_is_reached_from_the_readme() -> None:
    reached, waiting = set(), [HOME / "README.md"]
    while waiting:
        page = waiting.pop().resolve()
        if page not in reached and page.suffix == ".md":
            reached.add(page)
            found = links(page.read_text(encoding="utf-8"))
            waiting += [page.parent / link.partition("#")[0] for link in found if link[0] != "#"]
    assert [name_of(page) for page in PAGES if page not in reached] == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_commands_and_options_exist(page: Path, command: Any) -> None:
    assert dead(page) == []
    assert [words for words in calls(page.read_text()) if unknown(words, command)] == []


def test_what_is_wrong_is_seen(tmp_path: Path, command: Any) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# A head\n[a](#a-head) [b](#none) [c](page.md) [d](gone.md) [e](https://gone.org)\n"
        "```sh\nairzoo-bench check \\\n  --no-such x.npz\n```\n`airzoo-bench cheque x.npz`\n"
    )
    assert dead(page) == ["#none", "gone.md"]
    found = [unknown(words, command) for words in calls(page.read_text())]
    assert found == [["--no-such"], ["cheque"]]


def test_settings_are_all_sections_before_the_scenes() -> None:
    shown = re.findall(r'--8<-- "(protocols/.*):(\d+):(\d+)"', PROTOCOLS.read_text("utf-8"))
    assert len(shown) == 3
    for file, first, last in shown:
        lines = (HOME / file).read_text("utf-8").splitlines()
        sections = [number for number, line in enumerate(lines, 1) if line.startswith("[")]
        assert int(first) == sections[0]
        assert lines[int(last) + 1] == "[[scenes]]"


def test_the_module_of_an_added_benchmark_is_that_of_the_example() -> None:
    page = (HOME / "docs" / "add-a-benchmark.md").read_text(encoding="utf-8")
    [module] = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    source = HOME / "examples/benchmark-package/src/airzoo_bench_hills/__init__.py"
    assert module == source.read_text(encoding="utf-8")


def test_each_dependency_has_a_line_in_the_table() -> None:
    project = tomllib.loads((HOME / "pyproject.toml").read_text())["project"]
    needed = [project["dependencies"], *project["optional-dependencies"].values()]
    names = {re.match(r"[\w-]+", one)[0] for part in needed for one in part}  # type: ignore[index]
    page = (HOME / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page.partition("| package | why it |")[2].partition("\n\n")[0]
    firsts = " ".join(re.findall(r"^\| (`.*?) \|", table, re.MULTILINE))
    assert sorted(re.findall(r"[\w-]+", firsts)) == sorted(names - {"airzoo-bench"})


def test_security_and_mutants_name_tests_that_are_there() -> None:
    text = (HOME / "SECURITY.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    promises = [row for row in rows if not row.startswith(("| promise", "| ---"))]
    assert len(promises) > 15
    assert all("`tests/" in row for row in promises)
    text += (HOME / "pyproject.toml").read_text(encoding="utf-8")
    for name in re.findall(r"[`\"](tests/[\w/]+\.py[^`\"]*)", text):
        file, _, test = name.partition("::")
        tree = ast.parse((HOME / file).read_text(encoding="utf-8"))
        kinds = ast.FunctionDef | ast.ClassDef
        found = {one.name for one in ast.walk(tree) if isinstance(one, kinds)}
        found = {one for one in found if one.startswith(("test_", "Test"))}
        assert set(test.split("::") if test else ()) <= found != set(), name
