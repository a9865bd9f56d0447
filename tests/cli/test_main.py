"""Exit codes, streams, files and letters, as users and the operating system see them."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from airzoo_bench.cli.common import progress, working
from airzoo_bench.results.result import write_result
from tests.statistics.support import made_method, small_result, write_method
from tests.support import environment, files_below, run_main, write_predictions

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="shells and signals of POSIX")
LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.mark.parametrize(
    ("fault", "code", "message"),
    [
        (ZeroDivisionError("oops"), 70, "this is a bug of the suite"),
        (PermissionError(13, "Permission denied", "/x/y"), 2, "/x/y: Permission denied"),
        (OSError(28, "No space left on device"), 2, "a file: No space left on device"),
        (MemoryError("Unable to allocate 9 GiB"), 2, "run it on a machine with more memory"),
    ],
)
def test_a_bug_keeps_its_traceback_and_a_refusal_of_the_machine_has_none(
    fault: BaseException,
    code: int,
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*arguments: object) -> None:
        raise fault

    monkeypatch.setattr("airzoo_bench.cli.common.show_rows", refuse)
    assert run_main("protocols") == code
    said = capsys.readouterr().err
    assert message in said
    assert ("Traceback" in said) is (code == 70)


def test_a_wrong_call_exits_2(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for call in ("evil", "eval retrieval", "check --jobs", "table", f"check {'x' * 5000}"):
        assert run_main(*call.split()) == 2
        out, message = capsys.readouterr()
        assert out == ""
        assert "Error" in message or message.startswith("airzoo-bench: ")
        assert len(message) < 600


@pytest.mark.parametrize("form", ["terminal", "latex", "csv", "markdown", "html", "json"])
def test_a_method_s_name_is_shown_and_never_obeyed(form, data, tmp_path, perfect, capsys) -> None:
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    out = tmp_path / "out"
    name = "\x1b]0;x\x07[red]\n<b>\udcff$"
    assert run_main("eval", "retrieval", path, "--method", name, "-f", form, "--out", out) == 0
    again = shutil.copy(out / "result.json", tmp_path / "again.json")
    assert run_main("table", out / "result.json", again, "-f", form) == 0
    said = capsys.readouterr()
    assert all(c.isprintable() or c == "\n" for c in said.out + said.err)
    if form == "json":
        evaluated = json.JSONDecoder().raw_decode(said.out)[0]
        assert evaluated["predictions"]["method"] == "\ufffd]0;x\ufffd[red]\ufffd<b>\ufffd$"


def test_a_report_that_cannot_be_written_costs_no_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = write_method(tmp_path / "in", made_method({"east": {"recall@1": [1.0, 0.0]}})).parent
    monkeypatch.setattr("airzoo_bench.report.page.make_report", None)
    for out, named in (("x.txt", "x.txt: "), ("in/result.json/x.html", "in/result.json: ")):
        assert run_main("report", made, "-o", made.parent / out) == 2
        assert named in capsys.readouterr().err
    assert files_below(made.parent) == {"in", *(f"in/{path.name}" for path in made.iterdir())}


def test_a_folder_of_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main("table", tmp_path) == 2
    assert f"{tmp_path}/*" in capsys.readouterr().err


# --- streams ---


@pytest.mark.parametrize("form", ["latex", pytest.param("terminal", marks=pytest.mark.slow)])
def test_files_are_utf_8_whatever_the_terminal_takes(form: str, tmp_path: Path) -> None:
    zurich = "Z\N{LATIN SMALL LETTER U WITH DIAERESIS}rich"
    for name in (zurich, "Other"):
        write_result(tmp_path / f"{name[-1]}.json", small_result(name))
    call = [sys.executable, "-m", "airzoo_bench", "table", "h.json", "r.json", "-f", form]
    done = subprocess.run(call, capture_output=True, env=environment(**LOCALE), cwd=tmp_path)
    assert done.returncode == 0
    # A terminal is still told in the letters that it has.
    assert ("Z\\xfcrich" if form == "terminal" else zurich) in done.stdout.decode()
    assert done.stdout.isascii() is (form == "terminal")


@POSIX
@pytest.mark.parametrize(
    ("call", "code", "said"),
    [
        ("table none.json -f csv >&-", 2, b"no such result file"),
        pytest.param("table r.json -f csv 2>&-", 0, b"R@1", marks=pytest.mark.slow),
        ("table r.json -f csv <&- >&- 2>&-", 0, b""),
        ("protocols photos-matching | true", 0, b""),  # the reader of the pipe goes away
    ],
)
def test_closed_streams_are_no_fault(call: str, code: int, said: bytes, tmp_path: Path) -> None:
    write_result(tmp_path / "r.json", small_result())
    shell = ["bash", "-o", "pipefail", "-c", f'"{sys.executable}" -m airzoo_bench {call}']
    done = subprocess.run(shell, cwd=tmp_path, capture_output=True, env=environment())
    assert done.returncode == code
    assert b"Traceback" not in done.stdout + done.stderr
    assert said in done.stdout + done.stderr
    assert bool(done.stdout + done.stderr) is bool(said)


def test_work_is_shown_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    for is_shown in (True, False):
        stream = io.StringIO()
        stream.isatty = lambda: is_shown  # noqa: B023
        monkeypatch.setattr("sys.stderr", stream)
        with working("drawing [red]\x07.png"):
            # Work within work: some versions of rich refuse a second display.
            assert list(progress(range(3), "photos", 3)) == [0, 1, 2]
        assert ("drawing [red]\\x07.png" in stream.getvalue()) is is_shown
