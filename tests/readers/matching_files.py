"""Files of matching methods, written by each layout's own rules from a made world's truth."""

from __future__ import annotations

import pickle
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pycolmap

from airzoo_bench.geometry.poses import matrix_to_quaternion
from tests.matching.world import FOCAL, SIZE, World

TENSOR = (320, 224)  # another ratio than the photo's: both axes are stretched
FEATURES, MATCHES = "feats-superpoint-n4096-r1024.h5", "feats-superpoint-n4096-r1024_matches.h5"
IDENTITY = "1 0 0 0 0 0 0"
_UNMATCHED = np.array([[1.5, 2.5]])


class Pair(NamedTuple):
    """A photo and its crop: stem of the photo's name, pixels from the corner, sizes."""

    stem: str
    query_xy: Any
    map_xy: Any
    sizes: tuple[tuple[int, int], tuple[int, int]]


def pairs(world: World) -> Iterator[Pair]:
    rows = zip(world.ids, world.query_xy, world.map_xy, world.truth.crops.tolist(), strict=True)
    for one, query_xy, map_xy, (x, y, width, height) in rows:
        yield Pair(one.split("/", 1)[1], query_xy, map_xy - (x, y), (SIZE, (width, height)))


def _shrunk(pair: Pair, size: tuple[int, int] = TENSOR) -> list[Any]:
    sides = zip((pair.query_xy, pair.map_xy), pair.sizes, strict=True)
    return [xy * np.divide(size, one) - 0.5 for xy, one in sides]


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


# --- a file a pair ---


def write_loftr(folder: Path, world: World, **fields: Any) -> Path:
    home = _made(folder / "loftr")
    for pair in pairs(world):
        first, second = _shrunk(pair)
        given = {"mkpts0_f": first, "mkpts1_f": second, "mconf": np.ones(len(first), np.float32)}
        given |= {"image_size0": TENSOR, "image_size1": TENSOR} | fields
        given = {name: value for name, value in given.items() if value is not None}
        np.savez(home / f"{pair.stem}.npz", **given)
    return home


def write_superglue(folder: Path, world: World) -> Path:
    """Write what its script writes, and sizes of the pictures, which that does not."""
    home = _made(folder / "superglue")
    for pair in pairs(world):
        first, second = _shrunk(pair)
        count = len(first)
        np.savez(
            home / f"{pair.stem}_{pair.stem}_dom_matches.npz",
            keypoints0=np.vstack([first, [[1, 1]]]),
            keypoints1=second[::-1],
            matches=np.append(np.arange(count)[::-1], -1),
            match_confidence=np.ones(count + 1),
            image_size0=TENSOR,
            image_size1=TENSOR,
        )
    return home


def write_roma(folder: Path, world: World, *, pixels: bool = False) -> Path:
    home = _made(folder / "roma")
    for pair in pairs(world):
        sides = zip((pair.query_xy, pair.map_xy), pair.sizes, strict=True)
        matches = np.hstack([xy if pixels else 2 * xy / size - 1 for xy, size in sides])
        certainty = np.ones(len(matches), np.float32)
        np.savez(home / f"{pair.stem}.npz", matches=matches, certainty=certainty)
    return home


def write_dust3r(folder: Path, world: World) -> Path:
    """Write pixels of `load_images`; not rounded to whole ones, so that the truth comes back."""
    home = _made(folder / "dust3r")
    for pair in pairs(world):
        sides = zip((pair.query_xy, pair.map_xy), pair.sizes, strict=True)
        first, second = (_loaded(xy, one, 512) for xy, one in sides)
        np.savez(home / f"{pair.stem}.npz", matches_im0=first, matches_im1=second, size=512)
    return home


def _loaded(xy: Any, wide_high: tuple[int, int], size: int) -> Any:
    """What dust3r/utils/image.py does to a picture, done to its pixels."""
    width, height = wide_high
    scale = size / max(width, height)
    small = (round(width * scale), round(height * scale))
    cx, cy = small[0] // 2, small[1] // 2
    half_w, half_h = ((2 * cx) // 16) * 8, ((2 * cy) // 16) * 8
    if small[0] == small[1]:
        half_h = int(3 * half_w / 4)
    return xy * (small[0] / width, small[1] / height) - (cx - half_w, cy - half_h) - 0.5


def write_mast3r_visloc(folder: Path, world: World) -> Path:
    home = folder / "matches" / "tol_5"
    for pair in pairs(world):
        np.savez(
            _made(home / f"{pair.stem}.png") / f"{pair.stem}_dom.tif.npz",
            valid_pts3d=np.zeros((len(pair.query_xy), 3), np.float32),
            matches_im_query=pair.query_xy - 0.5,
            matches_im_map=pair.map_xy - 0.5,
            matches_conf=np.ones(len(pair.query_xy)),
        )
    return home


def write_aerialextrematch(folder: Path, world: World) -> Path:
    home = _made(folder / "aerialextrematch")
    for pair in pairs(world):
        np.save(home / f"{pair.stem}.npy", np.hstack([pair.query_xy, pair.map_xy]))
    return home


# --- hloc, as extract_features, match_features and match_dense write ---


def _hloc_pairs(world: World) -> Iterator[tuple[str, str, Any, Any, Any]]:
    """Yield names of photo and crop, their pixels as hloc counts them, and the crop's size."""
    for pair in pairs(world):
        names = f"photos/{pair.stem}.png", f"matching/crops/{pair.stem}_dom.tif"
        yield *names, pair.query_xy - 0.5, pair.map_xy - 0.5, pair.sizes[1]


def write_hloc(
    folder: Path,
    world: World,
    *,
    dtype: Any = np.float32,
    swapped: bool = False,
    libver: str = "latest",
) -> Path:
    home = _made(folder / "hloc")
    with (
        h5py.File(home / FEATURES, "w", libver=libver) as features,
        h5py.File(home / MATCHES, "w", libver=libver) as matches,
    ):
        for photo, crop, query_xy, map_xy, size in _hloc_pairs(world):
            _features(features, photo, np.vstack([query_xy, _UNMATCHED]), SIZE, dtype)
            # The crop has them in another order.
            order = np.random.default_rng(1).permutation(len(map_xy))
            _features(features, crop, np.vstack([_UNMATCHED, map_xy[order]]), size, dtype)
            names = (crop, photo) if swapped else (photo, crop)
            group = matches.create_group("/".join(n.replace("/", "-") for n in names))
            found = np.append(-1, order) if swapped else np.append(np.argsort(order) + 1, -1)
            group.create_dataset("matches0", data=found.astype(np.int16))
            group.create_dataset("matching_scores0", data=np.ones(len(found), np.float16))
    return home


def _features(file: Any, name: str, xy: Any, size: Any, dtype: Any) -> None:
    group = file.create_group(name)
    group.create_dataset("keypoints", data=xy.astype(dtype))
    group["keypoints"].attrs["uncertainty"] = 1.0
    group.create_dataset("descriptors", data=np.zeros((8, len(xy)), np.float16))
    group.create_dataset("image_size", data=np.array(size, np.int64))


def write_hloc_dense(folder: Path, world: World, *, scale: float = 1.0) -> Path:
    """Write matches of match_dense, whose matches0 count keypoints of a file that is not there."""
    path = folder / "matches-loftr.h5"
    with h5py.File(path, "w") as file:
        for photo, crop, query_xy, map_xy, _ in _hloc_pairs(world):
            group = file.create_group("/".join(n.replace("/", "-") for n in (photo, crop)))
            group.create_dataset("keypoints0", data=((query_xy + 0.5) * scale - 0.5))
            group.create_dataset("keypoints1", data=map_xy)
            group.create_dataset("matches0", data=np.full(9, -1, np.int32))
    return path


# --- pickles of vismatch, LoFTR and hloc ---


def write_vismatch(folder: Path, world: World) -> Path:
    """Write vismatch's `.torch`, as far as it can be without torch: a zip with a pickle."""
    home = _made(folder / "outputs" / "sift-lightglue")
    for number, pair in enumerate(pairs(world)):
        first, second = _shrunk(pair, (512, 512))
        result = {
            "matched_kpts0": first,
            "matched_kpts1": second,
            "img0_path": Path(f"photos/{pair.stem}.png"),
            "img1_path": Path(f"crops/{pair.stem}_dom.tif"),
            "matcher": ["sift-lightglue"],
        }
        with zipfile.ZipFile(home / f"output_{number}_result.torch", "w") as archive:
            archive.writestr("archive/data.pkl", pickle.dumps(result))
    return home


def load_torch(path: str, **options: Any) -> Any:
    """Stand in for `torch.load`."""
    assert options == {"weights_only": False}
    with zipfile.ZipFile(path) as archive:
        return pickle.loads(archive.read("archive/data.pkl"))  # noqa: S301 - written above


def write_loftr_dump(folder: Path, world: World) -> Path:
    dumps: Any = [
        {
            "pair_names": (f"photos/{pair.stem}.png", f"crops/{pair.stem}_dom.tif"),
            **dict(zip(("mkpts0_f", "mkpts1_f"), _shrunk(pair, (640, 480)), strict=True)),
        }
        for pair in pairs(world)
    ]
    np.save(folder / "LoFTR_pred_eval.npy", dumps)
    return folder / "LoFTR_pred_eval.npy"


def write_hloc_logs(folder: Path, world: World) -> Path:
    path = folder / "results.txt_logs.pkl"
    log = {"db": [1], "PnP_ret": None, "keypoints_query": np.zeros((3, 2))}
    path.write_bytes(pickle.dumps({"loc": dict.fromkeys(world.ids, log)}))
    return path


# --- poses ---


def write_hloc_poses(folder: Path, world: World) -> Path:
    """Write ``localize_sfm``'s results: basenames, w2c, w x y z."""
    return write_lines(folder / "hloc_results.txt", list(hloc_lines(world).values()))


def hloc_lines(world: World) -> dict[str, str]:
    """Return a line a photo, as ``hloc.utils.io.write_poses`` makes them, by the photo's name."""
    poses = world.truth.poses
    quaternions = matrix_to_quaternion(poses.rotation)
    rows = zip(world.truth.queries["image"], quaternions, poses.translation, strict=True)
    return {name: " ".join([name, *map(repr, map(float, (*q, *t)))]) for name, q, t in rows}


def write_tum(folder: Path, world: World) -> Path:
    """Write centres and camera-to-world quaternions x y z w, and ``names.txt``."""
    poses = world.truth.poses
    w, x, y, z = matrix_to_quaternion(np.swapaxes(poses.rotation, 1, 2)).T
    values = np.column_stack([np.arange(len(w)), poses.centres, x, y, z, w])
    return _numbers(folder, world, "tum.txt", values)


def write_kitti(folder: Path, world: World) -> Path:
    """Write camera-to-world matrices row by row, and ``names.txt``."""
    poses = world.truth.poses
    turned = np.swapaxes(poses.rotation, 1, 2)
    matrices = np.concatenate([turned, poses.centres[:, :, None]], axis=2)
    return _numbers(folder, world, "kitti.txt", matrices.reshape(-1, 12))


def _numbers(folder: Path, world: World, name: str, values: np.ndarray) -> Path:
    write_lines(folder / "names.txt", world.truth.queries["image"].tolist())
    rows = [" ".join(map(repr, map(float, row))) for row in values]
    return write_lines(folder / name, rows)


def write_lines(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_colmap(folder: Path, world: World, *, text: bool = False) -> Path:
    """Write a model with the queries and another photo registered in it, by pycolmap."""
    home, model, poses = _made(folder / "colmap"), pycolmap.Reconstruction(), world.truth.poses
    params = [FOCAL, SIZE[0] / 2, SIZE[1] / 2]
    camera = pycolmap.Camera(
        model="SIMPLE_PINHOLE", width=SIZE[0], height=SIZE[1], params=params, camera_id=1
    )
    model.add_camera_with_trivial_rig(camera)
    for number, name in enumerate([*world.truth.queries["image"], "other.jpg"], 1):
        row = min(number, len(poses)) - 1
        rotation = poses.rotation[row]
        image = pycolmap.Image(name=f"photos/{name}", camera_id=1, image_id=number)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([1.0, 2.0]))])
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ poses.centres[row])
        model.add_image_with_trivial_frame(image, pose)
    (model.write_text if text else model.write_binary)(str(home))
    return home
