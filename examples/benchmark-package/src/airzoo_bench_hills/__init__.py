"""The benchmark Hills: flights with a table of poses, a map and a surface model each."""

from pathlib import Path

from airzoo_bench.datasets.about import read_about
from airzoo_bench.datasets.table_dataset import PoseTable, TableDataset

HOME = Path(__file__).parent


class Hills(TableDataset):
    """Its tables have degrees of WGS84, heights of the surface model, and DJI's gimbal angles."""

    name = "hills"
    about = read_about(HOME / "about.toml")
    protocols = (str(HOME / "hills-retrieval.toml"),)
    images = "{scene}/photos"
    poses = PoseTable(
        "{scene}/poses.csv",
        "gimbal",
        {"image": "photo", "lon": "longitude", "lat": "latitude", "height": "altitude"},
    )
    dom = "{scene}/map.tif"
    dsm = "{scene}/surface.tif"
    crs = "EPSG:32633"
    lens = {"fov_deg": 53.13}  # noqa: RUF012


HILLS = Hills()
