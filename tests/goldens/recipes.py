"""Recipes that change an input: ``FILE: VERB REST``, parted by ``;;``.

``do STATEMENT`` runs Python on the fields of an npz or the keys of a JSON file, and
``py STATEMENT`` on the ``path`` itself; ``cut SHARE``, ``sed OLD => NEW``, ``text CONTENT``,
``from FILE`` and ``rm`` do what they say; ``checksums`` of a benchmark.toml become those of the
files as they are.
"""

from __future__ import annotations

import json
import shutil
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

PROJECT = Path(__file__).parents[2]


def steps(recipe: str) -> list[str]:
    """Return the steps of a recipe."""
    return [step.strip() for step in recipe.split(";;") if step.strip()]


def spoil(home: Path, step: str) -> None:
    """Change a file as a step of a recipe says."""
    name, _, action = step.partition(": ")
    path = home / name
    verb, _, rest = action.partition(" ")
    if verb == "do":
        (_change_npz if path.suffix == ".npz" else _change_json)(path, rest)
    elif verb == "checksums":
        listed = path.read_text("utf-8").partition("[checksums]\n")
        names = [line.split('"')[1] for line in listed[2].splitlines()]
        sums = {name: sha256((path.parent / name).read_bytes()).hexdigest() for name in names}
        lines = "".join(f'"{name}" = "{one}"\n' for name, one in sums.items())
        path.write_text(listed[0] + listed[1] + lines, encoding="utf-8")
    elif verb == "py":
        exec(rest, {"np": np, "path": path, "project": PROJECT})  # noqa: S102 - a line of cases.txt or refusals.txt
    elif verb == "cut":
        content = path.read_bytes()
        path.write_bytes(content[: int(len(content) * float(rest))])
    elif verb == "sed":
        old, new = (part.encode().decode("unicode_escape") for part in rest.split(" => "))
        text = path.read_text("utf-8")
        assert old in text, f"{name} has no {old!r}"
        path.write_text(text.replace(old, new), encoding="utf-8")
    elif verb == "text":
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(rest.encode().decode("unicode_escape").encode("latin-1"))
    elif verb == "from":
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(home / rest, path)
    else:
        assert verb == "rm", step
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def _change_npz(path: Path, statement: str) -> None:
    with np.load(path, allow_pickle=True) as file:
        fields = {name: file[name] for name in file.files}
    np.savez(path, **_changed(fields, statement))


def _change_json(path: Path, statement: str) -> None:
    path.write_text(json.dumps(_changed(json.loads(path.read_bytes()), statement)))


def _changed(fields: dict[str, Any], statement: str) -> dict[str, Any]:
    """Run a statement on fields by name; names that begin with ``_`` are its own."""
    scope = {"np": np, "nan": np.nan, **fields}
    exec(statement, scope)  # noqa: S102 - a line of cases.txt or refusals.txt
    return {name: value for name, value in scope.items() if name[0] != "_" and name not in HELPERS}


HELPERS = ("np", "nan")
