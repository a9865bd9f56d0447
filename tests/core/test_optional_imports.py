"""Matplotlib draws alike whatever its settings, and commands start without heavy imports."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import matplotlib

from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.report.figures import figure_bytes, new_canvas

USETEX = "text.usetex: True\nfont.size: 30\nfigure.facecolor: red\nsavefig.bbox: tight\n"


def drawn() -> bytes:
    figure = new_canvas(6, 4)
    with default_style():
        axes = figure.add_subplot()
        axes.plot([0, 1], [1, 2], label="a")
        axes.legend()
    return figure_bytes(figure, "png")


def run(script: str, folder: Path) -> bytes:
    """Run a script in a process of its own, whose heavy imports other tests need not meet."""
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, env=environment, capture_output=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_neither_a_folder_nor_a_program_rules_pictures(tmp_path: Path) -> None:
    plain = drawn()
    assert plain.startswith(b"\x89PNG")
    with matplotlib.rc_context({"font.size": 30, "figure.facecolor": "red"}):
        assert drawn() == plain
        assert matplotlib.rcParams["font.size"] == 30
    (tmp_path / "matplotlibrc").write_text(USETEX)
    script = f"import sys; from {__name__} import drawn; sys.stdout.buffer.write(drawn())"
    assert run(script, tmp_path) == plain


def test_commands_and_scores_of_ranked_ids_start_without_heavy_imports(tmp_path: Path) -> None:
    script = (
        "import sys\n"
        "import airzoo_bench.cli.main\n"
        "heavy = {'open3d', 'faiss', 'pycolmap', 'scipy', 'shapely', 'rasterio', 'PIL'}\n"
        "more = {'pandas', 'pyproj', 'pyarrow', 'matplotlib'}\n"
        "assert not (heavy | more) & set(sys.modules), (heavy | more) & set(sys.modules)\n"
        "import airzoo_bench.retrieval.track\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    run(script, tmp_path)
