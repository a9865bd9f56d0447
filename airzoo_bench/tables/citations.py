"""Citations of methods: by name, from a file, or those of published numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import read_toml
from airzoo_bench.tables.annotations import cite
from airzoo_bench.tables.model import Table

__all__ = ["add_citations"]


def add_citations(
    table: Table, given: Sequence[str], sources: Mapping[str, Mapping[str, str]]
) -> Table:
    """Attach citations; what is given later goes before what was given earlier.

    Parameters
    ----------
    table : Table
    given : sequence of str
        Each ``METHOD=KEY``, a ``.toml`` file with a key for each method, at its top or under
        ``[citations]``, or the name of a source.
    sources : mapping of str to mapping of str to str
        The citations of each source.

    Raises
    ------
    UsageError
        One is none of these, a file cannot be read, or a key is none.
    """
    keys: dict[str, str] = {}
    named: dict[str, str] = {}
    for text in given:
        method, sign, key = text.rpartition("=")
        if text.endswith(".toml"):
            keys |= _read(Path(text))
        elif text in sources:
            keys |= sources[text]
        elif sign and method:
            named[method] = key
        else:
            raise UsageError(
                f"--cite {text[:80]!r} is no citation",
                expected="METHOD=KEY, a .toml file, or one of " + ", ".join(sources),
            )
    cite(table, named, names_must_exist=True)
    return cite(table, keys | named)


def _read(path: Path) -> dict[str, str]:
    content = read_toml(path, UsageError, "file of citations")
    found = content.get("citations", content)
    if not isinstance(found, dict) or not all(isinstance(key, str) for key in found.values()):
        raise UsageError(
            "holds something else than citation keys",
            where=path,
            expected='a line such as "MegaLoc" = "berton2025megaloc" for each method',
        )
    return found
