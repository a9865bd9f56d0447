"""submission.toml: what is taken, and what hostile ones get."""

from __future__ import annotations

import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.submission import (
    Submission,
    read_submission,
    submission_text,
)
from tests.leaderboard.submission.support import submission, values


def refusal(path: Path, text: str | bytes) -> str:
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(SubmissionError) as error:
        read_submission(path)
    return str(error.value)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "submission.toml"


def test_what_is_written_is_read_again(path: Path) -> None:
    stated = submission(
        bibtex="@article{key,\n\ttitle = {Title}\n}",
    )
    path.write_text(submission_text(stated), encoding="utf-8")
    assert read_submission(path) == stated


def test_what_a_board_keeps_has_no_contact(path: Path) -> None:
    text = submission_text(submission().public())
    assert "ada@example.org" not in text
    assert "contact" not in text
    path.write_text(text, encoding="utf-8")
    assert read_submission(path, public=True) == submission().public()
    assert "key 'contact' is missing" in refusal(path, text)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "missing": (
        {"training_data": None},
        "key 'training_data' is missing",
    ),
    "unknown": ({"methd": "SALAD"}, "unknown key 'methd' (did you mean 'method'?)"),
    "type": ({"method": 3}, "key 'method' is 3: Input should be a valid string"),
    "date": ({"date": "2026-11-22"}, "key 'date' is '2026-11-22'"),
    "contact": ({"contact": "Ada"}, "key 'contact' is 'Ada': an e-mail address"),
    "http": ({"paper": "http://example.org"}, "key 'paper' is 'http://example.org'"),
    "user": ({"code": "https://github.com@evil.example/"}, "without a user"),
    "stages": (
        {"pipeline": {"stages": "two"}},
        "key 'pipeline.stages' is 'two': Input should be 'single-stage' or 're-ranked'",
    ),
    "two places": (
        {"predictions": {"file": "p.npz", "url": "https://a.b/p", "sha256": "0" * 64, "bytes": 1}},
        "key 'predictions': either file or url",
    ),
    "ANSI": ({"team": "\x1b[2Jlab"}, "key 'team' is '\\x1b[2Jlab': has U+001B"),
}


@pytest.mark.parametrize("kind", list(WRONG))
def test_each_mistake_is_named_with_an_example(kind: str, path: Path) -> None:
    changes, said = WRONG[kind]
    message = refusal(path, tomli_w.dumps(values(**changes)))
    assert said in message
    assert message.replace("\n", "").isprintable()
    assert "fix:      correct the submission file" in message


def test_a_file_of_50_mb_is_refused_by_its_size(path: Path) -> None:
    with path.open("wb") as stream:
        stream.truncate(50_000_000)
    with pytest.raises(SubmissionError, match="too large for a submission file"):
        read_submission(path)


@pytest.mark.parametrize(
    "text",
    [
        "method = " + "[" * 15_000,
        "method = " + "{a=" * 5_000,
        "method = " + "[" * 300 + "]" * 300,
        "method" + ".a" * 8_000 + " = 1",
        "[method" + ".a" * 8_000 + "]",
    ],
    ids=["arrays", "tables", "closed arrays", "dotted key", "dotted head"],
)
def test_nesting_without_end_is_refused(text: str, path: Path) -> None:
    assert len(refusal(path, text)) < 2_000


_LEAVES = st.one_of(
    st.text(max_size=20),
    st.integers(),
    st.floats(),
    st.booleans(),
    st.dates(),
    st.sampled_from(
        ["=1", "<b>", "\x1b[31m", "\u202e", "../x", "https://a.b/c", "SALAD", "0" * 64]
    ),
)
_TREES = st.recursive(
    _LEAVES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=6,
)


@given(st.data())
def test_any_values_are_taken_or_refused_with_a_message(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    known = [*Submission.model_fields, "schema", "strange"]
    keys = data.draw(st.lists(st.sampled_from(known), max_size=3))
    changed = values() | {key: data.draw(_TREES) for key in keys}
    _taken_or_refused(tmp_path_factory, tomli_w.dumps(changed).encode())


def _taken_or_refused(factory: pytest.TempPathFactory, content: bytes) -> None:
    path = factory.getbasetemp() / "fuzzed.toml"
    path.write_bytes(content)
    with suppress(SubmissionError):
        taken = read_submission(path)
        # What is taken is written and read again, as TOML and as what it was.
        again = Submission.model_validate(tomllib.loads(submission_text(taken)))
        assert again.model_dump() == taken.model_dump()
