"""The names of `airzoo_bench`: cheap to import, known to tools, documented, with examples."""

from __future__ import annotations

import ast
import doctest
import inspect
import json
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from numpydoc.validate import validate

import airzoo_bench as ab
from airzoo_bench.results.records import Method
from tests.statistics.support import ERROR, HIT, made_result, random_methods, write_method
from tests.support import made_protocol, write_benchmark, write_predictions

ROOT = Path(ab.__file__).parent
HEAVY = ("numpy", "pandas", "scipy", "open3d", "faiss", "rasterio", "matplotlib", "pycolmap")
NAMES = [name for name in ab.__all__ if not name.startswith("_")]
FUNCTIONS = [name for name in NAMES if inspect.isfunction(getattr(ab, name))]
OF_FILES = ("evaluate", "check", "load_benchmark", "load_result", "compare")
# No summary; parameters unknown, in another order, without type or description.
CODES = {"GL08", "SS01", "PR02", "PR03", "PR04", "PR07"}


def modules_after(code: str) -> set[str]:
    """Return the modules that another Python has once it ran this."""
    ask = f"{code}\nimport json, sys; print(json.dumps(list(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True)
    return set(json.loads(run.stdout))


def test_what_is_imported_when() -> None:
    loaded = modules_after("import airzoo_bench")
    assert loaded.isdisjoint(HEAVY)
    assert not [name for name in loaded if name.startswith("airzoo_bench.")]
    of_arrays = [name for name in FUNCTIONS if name not in OF_FILES]
    loaded = modules_after(f"import airzoo_bench as ab\nfor n in {of_arrays}: getattr(ab, n)")
    assert "numpy" in loaded
    assert loaded.isdisjoint({"open3d", "faiss", "matplotlib", "pycolmap"})


def test_all_the_lazy_table_and_what_type_checkers_see_agree() -> None:
    seen = {
        alias.name: node.module
        for branch in ast.parse(Path(ab.__file__).read_text()).body
        if isinstance(branch, ast.If)
        for node in branch.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == {name: f"airzoo_bench.{home}" for name, home in ab._HOME_OF.items()}
    assert sorted(ab.__all__) == sorted(seen)
    assert set(ab.__all__) <= set(dir(ab))
    assert len(NAMES) <= 26
    for name in NAMES:
        assert getattr(ab, name) is getattr(import_module(seen[name]), name)
    with pytest.raises(AttributeError, match="no attribute 'recal_at_k'"):
        ab.recal_at_k  # noqa: B018


def is_described(thing: Any, parameter: str) -> bool:
    """Whether a docstring has a section or a sentence on a parameter or attribute."""
    said = inspect.getdoc(thing) or ""
    stated = re.search(rf"^(.*, )?{parameter}(,.*)? :", said, re.MULTILINE)
    as_there = "Parameters are as in" in said
    return parameter.startswith("_") or f"`{parameter}` is" in said or bool(stated) or as_there


@pytest.mark.parametrize("name", NAMES)
def test_a_public_name_says_what_it_takes_and_raises(name: Any) -> None:
    thing = getattr(ab, name)
    wrong = []
    for code, message in validate(f"{thing.__module__}.{thing.__qualname__}")["errors"]:
        if code == "PR01":  # classes of fields say it in their own way
            own = not inspect.isclass(thing) or "__init__" in vars(thing)
            parameters = re.findall(r"'(\w+)'", message)
            wrong += [one for one in parameters if own and not is_described(thing, one)]
        elif code in CODES:
            wrong.append(message)
    assert wrong == []
    if inspect.isfunction(thing):
        assert re.search(r"Raises\s+an?\s+`\w+Error`", inspect.getdoc(thing) or "")


def run_examples(name: str, text: str, namespace: dict[str, Any]) -> str:
    """Run doctests, which see and leave names in a namespace; return what they say is wrong."""
    test = doctest.DocTestParser().get_doctest(text, {}, name, name, 0)
    test.globs = namespace
    said: list[str] = []
    runner = doctest.DocTestRunner(verbose=False, optionflags=doctest.NORMALIZE_WHITESPACE)
    found = runner.run(test, out=said.append, clear_globs=False)
    return "".join(said) if found.attempted else f"{name} shows nothing that runs"


def test_every_example(tmp_path, monkeypatch, scenes, perfect) -> None:
    for name in FUNCTIONS:
        said = inspect.getdoc(getattr(ab, name)) or ""
        assert ">>>" not in said or run_examples(name, said, {name: getattr(ab, name)}) == ""
    monkeypatch.chdir(tmp_path)
    made = random_methods(2, {"city": 40, "rural": 30}, [HIT, ERROR])
    for name, method in zip(("theirs", "mine"), made, strict=True):
        result = made_result(method.records, [HIT, ERROR], name)
        write_method(tmp_path / "results" / name, Method(name, result, method.records))
    write_benchmark(tmp_path / "data" / "made", made_protocol(scenes), scenes)
    write_predictions(tmp_path / "preds.npz", "made-retrieval", **perfect)
    page = (ROOT.parent / "docs" / "python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert {language for language, _ in blocks} == {"python"}
    namespace: dict[str, Any] = {}
    # One namespace for all: a page is read from its beginning.
    found = [run_examples(f"block {n}", text, namespace) for n, (_, text) in enumerate(blocks)]
    assert "".join(found) == ""
    shown = {name for name in FUNCTIONS if f"ab.{name}(" in page}
    assert shown == set(FUNCTIONS), "docs/python.md shows every function"
