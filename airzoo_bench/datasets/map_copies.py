"""Copies of maps, with the files that they need."""

from __future__ import annotations

import shutil
from pathlib import Path
from xml.etree import ElementTree as ET

from airzoo_bench.geometry.raster_files import place_source, source_elements, source_of
from airzoo_bench.geometry.rasters import opened

__all__ = ["copy_map"]


def copy_map(source: Path, target: Path) -> None:
    """Copy a raster with the files that it needs: world file, mask, tiles of a virtual raster."""
    with opened(source) as dataset:
        files, virtual = [Path(name) for name in dataset.files], dataset.driver == "VRT"
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
    for file in files:
        if file != source and file.parent == source.parent and file.stem.startswith(source.stem):
            # Such as dom.tfw or dom.tif.ovr, for a map that becomes dom.tif.
            rest = file.name.removeprefix(source.name)
            ending = target.suffix + rest if rest != file.name else file.suffix
            shutil.copyfile(file, target.with_name(target.stem + ending))
    if virtual:
        _copy_sources(source, target)


def _copy_sources(source: Path, target: Path) -> None:
    tree = ET.parse(source)
    home = target.with_name(f"{target.stem}_tiles")
    home.mkdir()
    copies: dict[Path, str] = {}
    for element in source_elements(tree):
        path = source_of(element, source)
        if path not in copies:
            copies[path] = f"{len(copies):04d}{path.suffix.lower()}"
            copy_map(path, home / copies[path])
        place_source(element, f"{home.name}/{copies[path]}")
    tree.write(target, encoding="utf-8")
