"""Effects of the camera on a photo: optics, highlights, drops, noise."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from airzoo_bench.datasets.mini.noise import Singles, gaussians, hash64, seed_of, uniforms
from airzoo_bench.datasets.mini.weather import Conditions
from airzoo_bench.geometry.arrays import Floats

# Light is kept as 16-bit integers, so that a photo of 48 megapixels stays small.
_STORED_ONE = np.float32(16384.0)
_STORED_MOST = np.float32(3.99)

_BLUR = np.float32(0.09)
# How much darker corners are than the middle.
_VIGNETTE = np.float32(0.12)
_SHOULDER = np.float32(0.88)
_DROPS = {"rain": 420, "snow": 520}

BLOCK_PIXELS = 1 << 16
"""How many pixels are worked on at once: as many as a processor's cache holds."""


def row_blocks(width: int, height: int) -> Iterator[slice]:
    """Yield slices of rows of an image, of `BLOCK_PIXELS` or a little less, at least one row."""
    rows = max(BLOCK_PIXELS // width, 1)
    for start in range(0, height, rows):
        yield slice(start, min(start + rows, height))


def to_stored(light: Singles) -> NDArray[np.uint16]:
    """Turn light (1.0 being white) into 16-bit integers."""
    return (np.clip(light, 0.0, _STORED_MOST) * _STORED_ONE).astype(np.uint16)


def from_stored(stored: NDArray[np.uint16]) -> Singles:
    """Turn 16-bit integers into light again."""
    return stored.astype(np.float32) * (np.float32(1.0) / _STORED_ONE)


def take_photo(
    light: NDArray[np.uint16], rotation: Floats, given: Conditions, seed: int
) -> NDArray[np.uint8]:
    """Turn the light (3, H, W) that reaches the lens, see `to_stored`, into an image (H, W, 3)."""
    _, height, width = light.shape
    drops = _drops(width, height, rotation, given.falling, seed) if given.falling else None
    photo = np.empty((height, width, 3), np.uint8)
    for rows in row_blocks(width, height):
        sharp = _blurred(light, rows)
        if drops is not None:
            share = drops[rows].astype(np.float32) * np.float32(1.0 / 255.0)
            white = np.array(given.horizon, np.float32)[:, None, None] * np.float32(1.05)
            sharp += (white - sharp) * share
        sharp *= _vignette(rows, width, height)
        # Highlights bend to white softly.
        over = np.maximum(sharp - _SHOULDER, 0.0)
        bent = np.minimum(sharp, _SHOULDER) + over / (1 + over / (1 - _SHOULDER))
        levels = bent * np.float32(255.0)
        levels += _noise(levels, rows, given.noise, seed)
        np.clip(levels, 0.0, 255.0, out=levels)
        photo[rows] = np.rint(levels, out=levels).transpose(1, 2, 0)
    return photo


def _blurred(light: NDArray[np.uint16], rows: slice) -> Singles:
    """Spread each pixel a little over its neighbours, as a lens does."""
    row = np.clip(np.arange(rows.start - 1, rows.stop + 1), 0, light.shape[1] - 1)
    part = from_stored(light[:, row])
    centre = 1 - 2 * _BLUR
    down = part[:, 1:-1] * centre + (part[:, :-2] + part[:, 2:]) * _BLUR
    across = down * centre
    across[..., 1:] += down[..., :-1] * _BLUR
    across[..., :-1] += down[..., 1:] * _BLUR
    across[..., 0] += down[..., 0] * _BLUR
    across[..., -1] += down[..., -1] * _BLUR
    return across


def _vignette(rows: slice, width: int, height: int) -> Singles:
    half = np.float32(np.hypot(width, height) / 2)
    x = (np.arange(width, dtype=np.float32) + 0.5 - width / 2) / half
    y = (np.arange(rows.start, rows.stop, dtype=np.float32) + 0.5 - height / 2) / half
    square = (y * y)[:, None] + (x * x)[None]
    return (1 - _VIGNETTE * square * square).astype(np.float32)


def _noise(levels: Singles, rows: slice, deviation: float, seed: int) -> Singles:
    width = levels.shape[2]
    pixels = np.arange(rows.start * width, rows.stop * width, dtype=np.uint64)
    normal = gaussians(hash64(pixels, seed)).reshape(4, -1, width)
    # Shot noise grows with the root of the light; read noise is always there.
    strength = np.sqrt(np.maximum(levels, 4.0) / np.float32(128.0)) * np.float32(deviation)
    noise: Singles = strength * (np.float32(0.8) * normal[:3] + np.float32(0.6) * normal[3])
    return noise


def _drops(width: int, height: int, rotation: Floats, falling: str, seed: int) -> NDArray[np.uint8]:
    """Return how much of each pixel (H, W) rain or snow in the air covers, in 255ths."""
    image = Image.new("L", (width, height))
    draw, count = ImageDraw.Draw(image), _DROPS[falling]
    hashes = hash64(np.arange(2 * count, dtype=np.uint64), seed_of(seed, falling))
    chance = np.stack([uniforms(hashes, lane) for lane in range(4)]).reshape(8, count)
    start = np.stack([chance[0] * 1.2 - 0.1, chance[1] * 1.2 - 0.1]) * [[width], [height]]
    near = chance[2] ** 3
    if falling == "rain":
        # Streaks lie along the way that drops fall as the camera sees it.
        fall = (rotation @ np.array([0.16, 0.05, -1.0]))[:2]
        length = (0.02 + 0.09 * near) * height
        jitter = np.stack([chance[3] - 0.5, 0.5 - chance[3]]) * 0.12
        ends = np.concatenate([start, start + (fall[:, None] + jitter) * length]).T
        thick, blur = max(round(height / 500), 1), 0.4
        for line, strength in zip(ends.tolist(), (26 + 60 * chance[4]).tolist(), strict=True):
            draw.line(line, fill=int(strength), width=thick)
    else:
        size, blur = (0.0012 + 0.0055 * near) * height, 0.7
        boxes = np.concatenate([start - size, start + size]).T
        for box, strength in zip(boxes.tolist(), (210 - 120 * near).tolist(), strict=True):
            draw.ellipse(box, fill=int(strength))
    return np.asarray(image.filter(ImageFilter.BoxBlur(blur * height / 480)))
