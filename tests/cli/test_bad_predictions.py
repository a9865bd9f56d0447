"""What bad predictions get: one message, exit code 2, and nothing half-written.

Each case makes a bad file, runs a command as its entry point does, and names the fragments that
the message must hold: which file, which field, which rows, what was expected and how to fix it.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.bad_prediction_cases import CASES
from tests.cli.bad_predictions import (
    Arrays,
    prediction_file,
)
from tests.support import files_below, run_main


@pytest.mark.parametrize("case", list(CASES))
def test_bad_predictions(
    case: str, data: Path, tmp_path: Path, arrays: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    make, fragments = CASES[case]
    path = prediction_file(tmp_path, make, arrays)
    before = files_below(tmp_path)
    assert run_main("eval", "retrieval", path, "--out", tmp_path / "out") == 2
    out, message = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in message
    assert "\x1b" not in message
    assert "\n  expected: " in message or "\n  fix:      " in message
    assert len(message) < 2000
    for fragment in fragments:
        assert fragment in message
    assert run_main("check", path) in (1, 2)
    assert "Traceback" not in capsys.readouterr().err
    assert files_below(tmp_path) == before
