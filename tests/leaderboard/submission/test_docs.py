"""docs/submission.md and the JSON Schema say what the model says.

``python -m tests.leaderboard.submission.test_docs`` writes both anew.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from airzoo_bench.core.validation import toml_value
from airzoo_bench.leaderboard.submission import SCHEMA_LINE, Submission, schema_text

DOCS = Path(__file__).resolve().parents[3] / "docs"
SCHEMA, PAGE = DOCS / "submission.schema.json", DOCS / "submission.md"
BLOCK = re.compile(r"(?<=<!-- keys -->\n).*?(?=<!-- /keys -->)", re.DOTALL)
EXAMPLE = re.compile(r"```toml\n(.*?)```", re.DOTALL)


def keys_table() -> str:
    """Return the table of all keys, as Markdown."""
    schema = json.loads(schema_text())
    rows = [
        "| key | needed | what | such as |",
        "| --- | --- | --- | --- |",
        *_rows(schema, schema),
    ]
    return "\n".join(rows) + "\n"


def _rows(schema: dict[str, Any], part: dict[str, Any], head: str = "") -> Iterator[str]:
    for key, field in part["properties"].items():
        needed = "yes" if key in part.get("required", ()) else ""
        inner = json.dumps(field).partition("#/$defs/")[2].partition('"')[0]
        if inner:
            optional = "" if needed else " The table may be left out."
            yield f"| `[{key}]` | {needed} | {field['description']}{optional} | |"
            yield from _rows(schema, schema["$defs"][inner], f"{key}.")
        else:
            example = toml_value(field["examples"][0])
            if field.get("format") == "date":
                example = example.strip('"')
            shown = example if len(example) < 60 else f"{example[:12]}...{example[-3:]}"
            what = field["description"].replace("|", "\\|")
            yield f"| `{head}{key}` | {needed} | {what} | `{shown}` |"


def test_the_schema_is_that_of_the_model() -> None:
    assert SCHEMA.read_text(encoding="utf-8") == schema_text(), __doc__


def test_the_page_lists_the_keys_of_the_model() -> None:
    [block] = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    assert block == keys_table(), __doc__


def test_the_example_of_the_page_is_a_submission() -> None:
    [text] = EXAMPLE.findall(PAGE.read_text(encoding="utf-8"))
    assert text.startswith(SCHEMA_LINE)
    Submission.model_validate(tomllib.loads(text))


if __name__ == "__main__":
    SCHEMA.write_text(schema_text(), encoding="utf-8")
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(BLOCK.sub(lambda _: keys_table(), page), encoding="utf-8")
