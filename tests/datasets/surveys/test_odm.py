"""OpenDroneMap projects: submodels, surfaces made of clouds, and what is wrong with a project."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio

from airzoo_bench.core.errors import UserError
from airzoo_bench.datasets.surveys.odm_lens import lens_of_camera
from tests.datasets.surveys.odm_projects import odm_project, write_odm_part
from tests.datasets.surveys.survey import CORNER, GROUND_M, Made, photos_layout, read_scene
from tests.support import BRIGHTON, files_below, run_main


def write_cloud(path: Path, points: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = points.min(axis=0), [0.001] * 3
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.write(path)


def ground_points(columns: tuple[int, int], up: float = 0.0) -> np.ndarray:
    """Return four points in each square metre of some columns; the highest is 0.3 above."""
    east, south = np.meshgrid(np.arange(*columns), np.arange(200))
    base = np.stack((CORNER[0] + east, CORNER[1] - south, np.full(east.shape, GROUND_M + up)), -1)
    offsets = np.array([(0.2, -0.2, 0), (0.7, -0.2, 0.3), (0.2, -0.7, 0), (0.7, -0.7, 0.1)])
    return (base[:, :, None] + offsets).reshape(-1, 3)


def split(made: Made, *, up: float = 0.0, clouds: bool = False) -> Path:
    """Turn the project into two submodels that share two photos, the second `up` metres higher."""
    project = odm_project(made, surface=not clouds)
    shutil.rmtree(project / "opensfm")
    shutil.rmtree(project / "odm_georeferencing")
    for number, rows in enumerate(([0, 1, 2], [1, 2, 3, 4])):
        part = project / "submodels" / f"submodel_000{number}"
        write_odm_part(made, part, rows, shift=(0, 0, up * number))
        if clouds:
            points = ground_points((0, 150) if number == 0 else (100, 240), up * number)
            write_cloud(part / "odm_georeferencing/odm_georeferenced_model.laz", points)
    return project


def test_submodels_are_one_scene(made: Made) -> None:
    expected = read_scene(photos_layout(made))

    found = read_scene(["odm", "--source", split(made, up=0.5)])

    assert found.names == expected.names
    up = found.poses.centres - expected.poses.centres
    np.testing.assert_allclose(up, np.outer((0, 0, 0, 0.5, 0.5), (0, 0, 1)), atol=1e-6)
    assert any("2 photos of two submodels" in n and "0.50 m in height" in n for n in found.notes)


def test_submodels_that_differ_bound_the_truth(made: Made) -> None:
    found = read_scene(["odm", "--source", split(made, up=0.4)])

    assert found.truth_accuracy_m == pytest.approx(0.4, abs=1e-3)
    assert "0.00 m in plan and 0.40 m in height" in " ".join(found.notes)


def test_control_points_bound_the_truth(made: Made) -> None:
    project = odm_project(made)
    path = project / "odm_report/stats.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps({"gcp_errors": {}, "gps_errors": {"error": {"x": 9}}}))
    assert read_scene(["odm", "--source", project]).truth_accuracy_m is None
    errors = {"average_error": 0.1, "error": {"x": 0.03, "y": 0.04, "z": 0.12}}
    path.write_text(json.dumps({"gcp_errors": errors}))

    found = read_scene(["odm", "--source", project])

    assert found.truth_accuracy_m == pytest.approx(0.13)
    assert "at ground control points 0.050 m remain in plan and 0.120 m" in " ".join(found.notes)
    stated = read_scene(["odm", "--source", project, "--truth-accuracy", 0.2])
    assert stated.truth_accuracy_m == 0.2


def test_submodels_may_have_either_file_of_shots(made: Made) -> None:
    project = split(made)
    second = project / "submodels/submodel_0001"
    shutil.rmtree(second)
    write_odm_part(made, second, [1, 2, 3, 4], shots=True)
    (project / "submodels/submodel_0002").mkdir()

    found = read_scene(["odm", "--source", project])

    assert len(found.names) == 5
    assert "submodels without shots: 1 (submodel_0002)" in found.notes


def test_clouds_become_a_surface_with_holes(made: Made) -> None:
    found = read_scene(["odm", "--source", split(made, up=0.4, clouds=True)])

    assert found.dsm is not None
    with rasterio.open(found.dsm) as raster:
        heights, transform = raster.read(1, masked=True), raster.transform
    assert (transform.a, transform.e) == (1.0, -1.0)
    assert (transform.c, transform.f) == CORNER
    assert heights.shape == (200, 240)
    np.testing.assert_allclose(heights[:, :100], GROUND_M + 0.3, atol=0.002)
    np.testing.assert_allclose(heights[:, 100:], GROUND_M + 0.7, atol=0.002)
    assert any("heights differ by 0.40 m" in note for note in found.notes)


def test_a_finer_surface_keeps_its_holes(made: Made) -> None:
    project = odm_project(made, surface=False)
    cloud = project / "odm_georeferencing/odm_georeferenced_model.laz"
    write_cloud(cloud, ground_points((0, 240)))

    found = read_scene(["odm", "--source", project, "--surface-cell", 0.25])

    assert any(note.endswith(f"--cloud {cloud}") for note in found.notes)
    with rasterio.open(found.dsm) as raster:
        heights = raster.read(1, masked=True)
    assert heights.count() == 4 * 200 * 240
    assert 0.2 < heights.count() / heights.size < 0.3


def test_the_parent_folder_will_do(made: Made) -> None:
    project = odm_project(made)
    (made.folder / "photos").rename(made.folder.parent / "elsewhere")

    found = read_scene(["odm", "--source", project.parent])

    assert found.images == project / "images"
    assert f"the project is {project}" in found.notes


def change(path: str, text: str) -> Callable[[Path], None]:
    return lambda project: (project / path).write_text(text)


def without(*paths: str) -> Callable[[Path], None]:
    def remove(project: Path) -> None:
        for path in paths:
            (project / path).unlink()

    return remove


def fisheye(project: Path) -> None:
    path = project / "opensfm/reconstruction.json"
    path.write_text(path.read_text().replace('"brown"', '"fisheye"'))


def other_photos(project: Path) -> None:
    for number, path in enumerate(sorted((project / "images").iterdir())):
        path.rename(path.with_name(f"IMG_{number}.jpg"))


def no_statistics(project: Path) -> None:
    (project / "odm_report").mkdir(exist_ok=True)
    (project / "odm_report/stats.json").write_text('{"gcp_errors": {"error": {"x": "far"}}}')


def shots_elsewhere(project: Path) -> None:
    shot = {"filename": "DJI_0001.JPG", "rotation": [3.1, 0, 0], "translation": [0, 0, 0]}
    features = [{"type": "Feature", "properties": shot}]
    (project / "odm_report/shots.geojson").write_text(json.dumps({"features": features}))


def cut_off(project: Path) -> None:
    path = project / "opensfm/reconstruction.json"
    path.write_text(path.read_text()[:200])


WRONG: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "no shots": (
        without("opensfm/reconstruction.json"),
        ["no project", "odm_report/shots.geojson"],
    ),
    "nothing places them": (
        without("opensfm/geocoords_transformation.txt"),
        ["cannot be placed by opensfm/reconstruction.json", "geocoords_transformation.txt"],
    ),
    "no statistics": (no_statistics, ["gcp_errors.error.x", "stats.json"]),
    "cut off": (cut_off, ["reconstruction.json", "as OpenDroneMap writes it"]),
    "no orthophoto": (without("odm_orthophoto/odm_orthophoto.tif"), ["--dom"]),
    "no surface": (without("odm_dem/dsm.tif"), ["odm_georeferenced_model.laz", "--dsm"]),
    "two CRS": (
        change("odm_georeferencing/coords.txt", "WGS84 UTM 15N\n1 2\n"),
        ["different CRS", "EPSG:32615", "EPSG:32633"],
    ),
    "no CRS known": (
        change("odm_georeferencing/proj.txt", "+proj=nothing"),
        ["proj.txt", "+proj=nothing", "PROJ string"],
    ),
    "a fisheye": (fisheye, ["fisheye", "--camera-lens brown"]),
    "other photos": (other_photos, ["none of its 5 names is among 5 photos", "IMG_0.jpg"]),
    "two runs": (shots_elsewhere, ["m apart (median)", "files of one run"]),
    "no matrix": (
        change("opensfm/geocoords_transformation.txt", "1 0 0\n"),
        ["is no matrix", "4 lines of 4 numbers"],
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_one_message_and_nothing_written(
    what: str, made: Made, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    project = odm_project(made)
    spoil, expected = WRONG[what]
    spoil(project)
    before = files_below(made.folder)

    assert run_main("prepare", "odm", "--source", project, "--name", "place") == 2

    said = capsys.readouterr().err
    assert said.startswith("airzoo-bench: ")
    for text in expected:
        assert text in said
    assert files_below(made.folder) == before
    assert not data.exists() or files_below(data) == set()


def test_a_camera_of_another_shape_is_refused() -> None:
    camera = {"projection_type": "perspective", "focal": 0.8, "k1": 0, "k2": 0}
    size = {"width": 400, "height": 300}
    matrix, distortion = lens_of_camera(camera | size, (4000, 3000), "cameras.json")
    assert matrix == [[3200, 0, 2000], [0, 3200, 1500], [0, 0, 1]]
    assert distortion == (0, 0, 0, 0, 0)
    with pytest.raises(UserError, match="its camera is 400x300 px, a photo 3000x4000"):
        lens_of_camera(camera | size, (3000, 4000), "cameras.json")


@pytest.mark.skipif(not BRIGHTON.is_dir(), reason=f"{BRIGHTON} is absent")
def test_brighton_in_this_layout(tmp_path: Path) -> None:
    """The real scene's poses, map and cloud as a project: its truth, and a surface like its own."""
    from scipy.spatial.transform import Rotation

    file = json.loads((BRIGHTON / "poses.json").read_text())
    project = tmp_path / "project"
    for folder in ("odm_report", "odm_georeferencing", "odm_orthophoto"):
        (project / folder).mkdir(parents=True)
    (project / "images").symlink_to((BRIGHTON / "images").resolve())
    features = [
        {
            "properties": {
                "filename": name,
                "rotation": Rotation.from_matrix(image["R_w2c"]).as_rotvec().tolist(),
                "translation": image["center_utm"],
            }
        }
        for name, image in file["images"].items()
    ]
    (project / "odm_report/shots.geojson").write_text(json.dumps({"features": features}))
    (fx, _, cx), (_, fy, cy), _ = file["K"]
    camera = dict(zip(("k1", "k2", "p1", "p2"), file["dist_k1k2p1p2"], strict=True)) | {
        "projection_type": "brown",
        "k3": 0.0,
        **{"focal_x": fx / 4000, "focal_y": fy / 4000},
        **{"c_x": (cx - 2000) / 4000, "c_y": (cy - 1125) / 4000},
    }
    (project / "cameras.json").write_text(json.dumps({"dji fc300s 4000 2250 brown": camera}))
    (project / "odm_georeferencing/coords.txt").write_text("WGS84 UTM 15N\n576673 5188174\n")
    shutil.copy(BRIGHTON / "dom_10cm.tif", project / "odm_orthophoto/odm_orthophoto.tif")
    shutil.copy(BRIGHTON / "model.laz", project / "odm_georeferencing/odm_georeferenced_model.laz")
    own = ["photos", "--poses", BRIGHTON / "poses.json", "--images", BRIGHTON / "images"]
    maps = ["--dom", BRIGHTON / "dom_10cm.tif", "--dsm", BRIGHTON / "dsm_10cm.tif"]
    expected = read_scene([*own, *maps])

    found = read_scene(["odm", "--source", project, "--surface-cell", 0.1])

    assert found.names == expected.names
    assert found.crs == expected.crs
    np.testing.assert_allclose(found.poses.centres, expected.poses.centres, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.poses.rotation, expected.poses.rotation, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.priors.centres, expected.priors.centres, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.cameras.focal, expected.cameras.focal, rtol=1e-12)
    np.testing.assert_allclose(
        found.cameras.principal_point, expected.cameras.principal_point, rtol=1e-12
    )
    np.testing.assert_array_equal(found.cameras.distortion, expected.cameras.distortion)
    with rasterio.open(found.dsm) as ours, rasterio.open(expected.dsm) as theirs:
        heights = ours.read(1, masked=True)
        rows, columns = np.nonzero(~heights.mask)
        xs, ys = rasterio.transform.xy(ours.transform, rows[::50], columns[::50])
        at = np.array([value[0] for value in theirs.sample(zip(xs, ys, strict=True))])
    both = np.isfinite(at)
    assert both.mean() > 0.9
    away = heights[rows[::50], columns[::50]].data[both] - at[both]
    assert abs(np.median(away)) < 0.05
