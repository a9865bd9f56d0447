"""Photos as methods see them: read small, refused where they are turned or damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from airzoo_bench.benchmark.images import photo_size, read_grey
from airzoo_bench.core.errors import BenchmarkError


def test_photos_are_read_small_and_turned_ones_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    Image.new("RGB", (640, 320), (255, 0, 0)).save(path)
    assert photo_size(path) == (640, 320)
    grey = read_grey(path, 64)
    assert grey.shape == (32, 64)
    assert abs(int(grey[5, 5]) - 76) <= 1  # 0.299 of red
    assert read_grey(path, 1000).shape == (320, 640)
    for orientation, refused in ((0, False), (1, False), (3, True), (6, True), (9, False)):
        exif = Image.Exif()
        exif[0x0112] = orientation
        Image.new("RGB", (640, 320)).save(path, exif=exif)
        if refused:
            with pytest.raises(BenchmarkError, match=rf"EXIF orientation {orientation}\)"):
                photo_size(path)
        else:
            assert photo_size(path) == (640, 320)


def test_photos_that_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    with pytest.raises(
        BenchmarkError, match=r"a\.jpg: not a readable photo: No such file[\s\S]*back"
    ):
        read_grey(path, 64)
    noise = np.random.default_rng(0).integers(0, 256, (320, 640, 3), np.uint8)
    Image.fromarray(noise).save(path)
    path.write_bytes(path.read_bytes()[:5000])
    assert photo_size(path) == (640, 320)
    with pytest.raises(BenchmarkError, match=r"not a readable photo: .*truncated"):
        read_grey(path, 64)
