"""Where commands write, as the operating system sees it: files, closed and plain streams, stops."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from airzoo_bench.results.result import write_result
from tests.cli.environment import environment
from tests.results.made import result
from tests.statistics.support import made_method, write_method
from tests.support import files_below, run_main

SCENES = {"east": {"recall@1": [1.0, 0.0, 1.0]}, "west": {"recall@1": [0.0, 1.0]}}
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="shells and signals of POSIX")


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """Return a folder with a result and records, and the same under endings that are written."""
    folder = write_method(tmp_path / "in", made_method(SCENES)).parent
    for ending in ("html", "svg"):
        shutil.copy(folder / "result.json", folder / f"a.{ending}")
    shutil.copy(folder / "records.csv", folder / "a.records.csv")
    return folder


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("x.txt", "x.txt: a report is a page"),
        ("in/result.json/x.html", "in/result.json: a file, not a folder"),
        ("x" * 300 + ".html", "cannot be written: "),
    ],
)
def test_a_report_that_cannot_be_written_costs_no_work(
    out: str,
    message: str,
    made: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("airzoo_bench.report.page.make_report", None)
    assert run_main("report", made, "-o", made.parent / out) == 2
    assert message in capsys.readouterr().err
    assert files_below(made.parent) == {"in", *(f"in/{path.name}" for path in made.iterdir())}


@pytest.mark.parametrize("ending", [".html", ".HTM"])
def test_maps_are_all_that_an_unreadable_folder_costs(
    ending: str,
    made: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Whoever may do everything may read every folder; none can look into one of such a name.
    folder = "x" * 300
    monkeypatch.setenv("AIRZOO_BENCH_DATA", folder)
    out = made.parent / f"x{ending}"
    assert run_main("report", made, "-o", out) == 0
    assert "no maps and pictures for made: " in capsys.readouterr().err
    assert out.is_file()
    assert run_main("report", made, "-o", out, "--data", folder) == 2


def started(*arguments: object, **more: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "airzoo_bench", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, env=environment(**more), check=False)


@pytest.mark.parametrize("form", ["latex", "terminal"])
def test_files_are_utf_8_whatever_the_terminal_takes(form: str, tmp_path: Path) -> None:
    for name in ("Z\N{LATIN SMALL LETTER U WITH DIAERESIS}rich", "Other"):
        write_result(tmp_path / f"{name[-1]}.json", result(name))
    locale = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = started("table", tmp_path / "h.json", tmp_path / "r.json", "-f", form, **locale)
    assert done.returncode == 0
    # A terminal is still told in the letters that it has.
    expected = (
        "Z\\xfcrich" if form == "terminal" else "Z\N{LATIN SMALL LETTER U WITH DIAERESIS}rich"
    )
    assert expected in done.stdout.decode()
    assert done.stdout.isascii() is (form == "terminal")
    assert (b"R@1 [%] \\u2191" in done.stdout) is (form == "terminal")


@POSIX
@pytest.mark.parametrize(
    ("closed", "file", "code", "said"),
    [
        (">&-", "none.json", 2, b"no such result file"),
        ("2>&-", "r.json", 0, b"R@1"),
        ("<&- >&- 2>&-", "r.json", 0, b""),
    ],
)
def test_closed_streams_are_no_fault(
    closed: str, file: str, code: int, said: bytes, tmp_path: Path
) -> None:
    write_result(tmp_path / "r.json", result())
    call = f'"{sys.executable}" -m airzoo_bench "$@" {closed}'
    done = subprocess.run(
        ["sh", "-c", call, "sh", "table", file, "-f", "csv"],
        cwd=tmp_path,
        capture_output=True,
        env=environment(PYTHONPATH=str(Path(__file__).parents[2])),
        check=False,
    )
    assert done.returncode == code
    assert b"Traceback" not in done.stdout + done.stderr
    assert said in done.stdout + done.stderr
    assert bool(done.stdout + done.stderr) is bool(said)


@POSIX
@pytest.mark.parametrize(
    "stopped", ["airzoo_bench.cli.main", "airzoo_bench.cli.main.app", "airzoo_bench.cli.main.main"]
)
def test_a_stop_before_the_command_line_looks_for_one(stopped: str) -> None:
    # The signal comes as that module is asked for, or when that function is called.
    slowed = (
        "import signal, sys\n"
        "from airzoo_bench import __main__\n"
        "def stop(*given, **more):\n"
        "    signal.raise_signal(signal.SIGINT)\n"
        f"module, _, name = {stopped!r}.removeprefix('airzoo_bench.cli.').partition('.')\n"
        "class Finder:\n"
        "    def find_spec(self, name, *given):\n"
        "        if name == 'airzoo_bench.cli.main':\n"
        "            stop()\n"
        "if name:\n"
        "    from airzoo_bench.cli import main\n"
        "    setattr(main, name, stop)\n"
        "else:\n"
        "    sys.meta_path.insert(0, Finder())\n"
        "__main__.main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", slowed], capture_output=True, env=environment(), check=False
    )
    assert done.returncode == 130
    assert done.stderr.decode() == "airzoo-bench: stopped; nothing was left half-written\n"
