"""AerialExtreMatch's localisation set, as it is downloaded, of a made-up place."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.geometry.poses import matrix_to_quaternion
from tests.datasets.published.changsha import (
    FOCAL_PX,
    SIZE_PX,
    Shot,
    poses_of_shots,
    write_map,
    write_photo,
    write_surface,
)

SHOTS = {
    f"DJI_20240101_{number:04d}_W": Shot(
        120.0 + 40.0 * (number % 3), 170.0 + 30.0 * (number // 3), yaw=number * 25.0
    )
    for number in range(6)
}
OFF = {"x": 6.0, "y": -4.0, "up": 2.0, "yaw": 1.5}


def make_tree(folder: Path) -> Path:
    """Write the set; priors are `OFF` the truth. HQ has its georeference in other files."""
    width, height = SIZE_PX
    poses = poses_of_shots(SHOTS)
    lines, lenses = [], []
    for number, (name, shot) in enumerate(SHOTS.items()):
        write_photo(folder / "rgb" / f"{name}.JPG", shot.moved(**OFF))
        wxyz = matrix_to_quaternion(poses.rotation[[number]])[0]
        values = " ".join(f"{value:.17g}" for value in (*wxyz, *poses.translation[number]))
        lines.append(f"{name}.JPG {values}\n")
        lenses.append(
            f"{name}.JPG PINHOLE {width} {height} {FOCAL_PX} {FOCAL_PX} {width / 2} {height / 2}\n"
        )
    (folder / "gt_pose.txt").write_text("".join(lines))
    (folder / "intrinsic.txt").write_text("".join(lenses))
    write_map(folder / "HQref" / "Production_4_ortho_merge.tif", 1.0, bare=True)
    write_surface(
        folder / "HQref" / "Production_4_DSM_merge.tif", 1.0, bare=True, hole=True, nodata=None
    )
    write_map(folder / "LQref" / "Production_5_ortho_merge.tif", 2.0, seed=1)
    write_surface(folder / "LQref" / "Production_5_DSM_merge.tif", 2.0)
    return folder
