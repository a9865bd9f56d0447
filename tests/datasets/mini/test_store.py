"""Worlds on disk: what is saved is loaded, and damage is found and corrected."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from airzoo_bench.datasets.mini import world as store
from airzoo_bench.datasets.mini.world import (
    Buildings,
    Mesh,
    Region,
    World,
    ensure_world,
    load_world,
    save_world,
    world_folder,
)
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.rasters import read_rgb

REGION = Region("yard", 401_000.0, 3_120_000.0, 60.0)


def colours(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.integers(0, 256, (*shape, 3), dtype=np.uint8)


def made_world(seed: int = 7, vertices: int = 50_000) -> World:
    """Return a world of noise; its vertices are large enough to be mapped, it has no trees."""
    rng = np.random.default_rng(seed)
    dsm = rng.uniform(30.0, 90.0, (12, 12)).astype(np.float32)
    dsm[3, 4] = np.nan
    return World(
        region=REGION,
        seed=seed,
        mesh=Mesh(
            rng.normal(size=(vertices, 3)),
            rng.integers(0, vertices, (20, 3), dtype=np.int32),
            rng.integers(0, 6, 20, dtype=np.uint8),
            rng.integers(-1, 9, 20, dtype=np.int32),
        ),
        buildings=Buildings(
            colours(rng, 5),
            colours(rng, 5),
            rng.random(5),
            rng.random(5),
            rng.random(5),
            rng.integers(0, 4, 5, dtype=np.uint8),
        ),
        tree_colours=np.zeros((0, 3), np.uint8),
        ground_albedo=colours(rng, 24, 24),
        top_albedo=colours(rng, 24, 24),
        water=rng.random((24, 24)) < 0.5,
        dsm=dsm,
        dom=colours(rng, 24, 24),
        satellite=colours(rng, 20, 20),
    )


def same(a: Any, b: Any) -> bool:
    """Whether two dataclasses hold the same values, types and shapes, down to the last bit."""
    if dataclasses.is_dataclass(a):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    return bool(a == b)


class Builder:
    """Builds worlds and counts them."""

    def __init__(self) -> None:
        self.built: list[tuple[str, int]] = []

    def build(self, name: str, seed: int) -> World:
        self.built.append((name, seed))
        return made_world(seed)

    def cached(self, root: Path, seed: int = 7) -> World:
        return load_world(ensure_world(REGION, seed, root, self.build))


def leftovers(root: Path) -> list[str]:
    """Names below the cache's folder that are no world."""
    return [p.name for p in (root / "mini-worlds").iterdir() if p.name.startswith(".yard")]


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    world = made_world()
    save_world(tmp_path / "w", world)
    assert same(load_world(tmp_path / "w"), world)


def test_the_same_world_gives_the_same_bytes(tmp_path: Path) -> None:
    folders = tmp_path / "a", tmp_path / "b"
    for folder in folders:
        save_world(folder, made_world())
    names = [sorted(p.name for p in folder.iterdir()) for folder in folders]
    assert names[0] == names[1]
    assert all((folders[0] / n).read_bytes() == (folders[1] / n).read_bytes() for n in names[0])


def test_other_programs_find_the_rasters_in_place(tmp_path: Path) -> None:
    world = made_world()
    save_world(tmp_path / "w", world)
    for name, pixel in (("dom", 2.5), ("dsm", 5.0), ("satellite", 3.0)):
        with rasterio.open(tmp_path / "w" / f"{name}.tif") as dataset:
            assert dataset.crs.to_epsg() == 4547
            assert tuple(dataset.bounds) == (401_000.0, 3_120_000.0, 401_060.0, 3_120_060.0)
            assert dataset.res == (pixel, pixel)
            assert dataset.nodata == (-9999.0 if name == "dsm" else None)
    assert np.array_equal(read_rgb(tmp_path / "w" / "dom.tif"), world.dom)
    field = HeightField.read(tmp_path / "w" / "dsm.tif")
    # The first row is the northernmost: its first pixel's centre is 2.5 m from the corner.
    assert field.sample((401_002.5, 3_120_057.5)) == world.dsm[0, 0]
    assert np.isnan(field.sample((401_022.5, 3_120_042.5)))


def test_a_world_is_built_once(tmp_path: Path) -> None:
    builder = Builder()
    worlds = [builder.cached(tmp_path) for _ in range(3)]
    assert builder.built == [("yard", 7)]
    assert same(worlds[0], worlds[2])
    assert not leftovers(tmp_path)


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


DAMAGES = {
    "a bit of a raster": lambda f: flip(f / "dom.tif"),
    "cut short": lambda f: os.truncate(f / "dsm.tif", 100),
    "missing": lambda f: (f / "world.npz").unlink(),
    "another world": lambda f: (f / "checksums.json").write_text(
        (f / "checksums.json").read_text().replace('"seed":7', '"seed":8')
    ),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_world_is_made_again(tmp_path: Path, damage: str) -> None:
    builder = Builder()
    builder.cached(tmp_path)
    DAMAGES[damage](world_folder(tmp_path, REGION, 7))
    assert same(builder.cached(tmp_path), made_world())
    assert len(builder.built) == 2
    builder.cached(tmp_path)
    assert len(builder.built) == 2
    assert not leftovers(tmp_path)


def test_an_interrupt_leaves_nothing_half_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(folder: Path, *_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(store, "write_raster", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save_world(tmp_path / "worlds" / "w", made_world())
    assert not list((tmp_path / "worlds").iterdir())
