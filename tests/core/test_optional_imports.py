"""Matplotlib draws alike whatever its settings; Open3D imports; nothing else pulls them in."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np

from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.report.figures import figure_bytes, new_canvas

ROOT = Path(__file__).resolve().parents[2]
DRAW = (
    "import sys\n"
    "from airzoo_bench.core.optional_imports import default_style\n"
    "from airzoo_bench.report.figures import figure_bytes, new_canvas\n"
    "figure = new_canvas(6, 4)\n"
    "with default_style():\n"
    "    axes = figure.add_subplot()\n"
    "    axes.plot([0, 1], [1, 2], label='a')\n"
    "    axes.set_title('of a thing')\n"
    "    axes.legend()\n"
    "sys.stdout.buffer.write(figure_bytes(figure, 'png'))\n"
)
USETEX = "text.usetex: True\nfont.size: 30\nfigure.facecolor: red\nsavefig.bbox: tight\n"


def test_neither_a_folder_nor_a_backend_rules_pictures(tmp_path: Path) -> None:
    plain = io.BytesIO()
    exec(DRAW.replace("sys.stdout.buffer", "out"), {"out": plain})  # noqa: S102 - without either
    assert plain.getvalue().startswith(b"\x89PNG")
    (tmp_path / "matplotlibrc").write_text(USETEX)
    done = subprocess.run(
        [sys.executable, "-c", DRAW],
        capture_output=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "nonsense"},
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout == plain.getvalue()


def test_settings_of_the_program_rule_no_picture_and_stay() -> None:
    def draw() -> bytes:
        figure = new_canvas(6, 4)
        with default_style():
            figure.add_subplot().plot([0, 1], [1, 2])
        return figure_bytes(figure, "png")

    plain = draw()
    with matplotlib.rc_context({"font.size": 30, "figure.facecolor": "red"}):
        assert draw() == plain
        assert matplotlib.rcParams["font.size"] == 30


def test_open3d_computes() -> None:
    script = (
        "from airzoo_bench.core.optional_imports import load_open3d\n"
        "o3d = load_open3d()\n"
        "import numpy as np\n"
        "cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.eye(3)))\n"
        "moved = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.eye(3) + [0, 0, 2]))\n"
        "print(list(cloud.compute_point_cloud_distance(moved)))\n"
    )
    # A process of its own: Open3D brings warnings and handlers that other tests need not meet.
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    # (1, 0, 0) to (1, 0, 2) is 2; so for the second; (0, 0, 1) to (0, 0, 3) is 2, to (1, 0, 2) is
    # the root of 2.
    np.testing.assert_allclose(eval(run.stdout, {}), [2, 2, np.sqrt(2)])


def test_commands_and_scores_of_ranked_ids_start_without_heavy_imports() -> None:
    script = (
        "import sys\n"
        "import airzoo_bench.cli.main\n"
        "heavy = {'open3d', 'faiss', 'pycolmap', 'scipy', 'shapely', 'rasterio', 'PIL'}\n"
        "more = {'pandas', 'pyproj', 'pyarrow', 'matplotlib'}\n"
        "assert not (heavy | more) & set(sys.modules), (heavy | more) & set(sys.modules)\n"
        "import airzoo_bench.retrieval.track\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
