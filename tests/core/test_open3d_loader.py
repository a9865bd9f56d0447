"""Open3D imports on the machine as it is, and nothing else pulls it in."""

from __future__ import annotations

import subprocess
import sys

import numpy as np


def test_open3d_computes() -> None:
    script = (
        "from airzoo_bench.core.open3d_loader import load_open3d\n"
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


def test_the_command_line_starts_without_heavy_imports() -> None:
    script = (
        "import sys\n"
        "import airzoo_bench.cli.main\n"
        "heavy = {'open3d', 'faiss', 'pycolmap', 'pandas', 'scipy', 'shapely', 'rasterio',"
        " 'pyproj', 'pyarrow', 'PIL', 'matplotlib'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_scoring_ranked_ids_needs_no_heavy_imports() -> None:
    script = (
        "import sys\n"
        "import airzoo_bench.retrieval.track\n"
        "heavy = {'open3d', 'faiss', 'pycolmap', 'scipy', 'shapely', 'rasterio', 'PIL'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
