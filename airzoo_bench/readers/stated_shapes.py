"""What the stated sizes of resized pictures tell: that they were padded, or exchanged."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp, log
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import PredictionError, counted

if TYPE_CHECKING:
    from airzoo_bench.geometry.arrays import Floats
    from airzoo_bench.readers.pictures import Picture

__all__ = ["Sizes", "StatedShapes"]

Sizes = tuple[tuple[float, float], tuple[float, float]]
"""Width and height of the first and of the second picture, as the model was given them."""

_PADDED_SHARE = 0.9  # of a side, from which on rounding to multiples of 32 may be all there is
_SLACK_PX = 2.0
_LEAST_PADDED, _LEAST_MATCHES = 10, 500
_LEAST_EXCHANGED, _NEARLY_ALL = 3, 0.9
_SAME_SHAPE, _OTHER_SHAPE = 0.05, 0.15  # differences of the logarithms of width by height


@dataclass
class _Side:
    pictures: int = 0
    matches: int = 0
    beyond: bool = False


@dataclass
class StatedShapes:
    """Holds the sizes that files state against the shapes of the pictures, file by file."""

    _told: int = 0
    _exchanged: int = 0
    _sides: dict[str, _Side] = field(default_factory=dict)

    def add(self, pair: tuple[Picture, Picture], xy: tuple[Floats, Floats], sizes: Sizes) -> None:
        """Take a file: its pictures, pixels of their full sizes, and the sizes that it states."""
        self._look_for_exchange(pair, sizes)
        for picture, pixels, size in zip(pair, xy, sizes, strict=True):
            self._look_for_padding(picture, pixels, size)

    def _look_for_exchange(self, pair: tuple[Picture, Picture], sizes: Sizes) -> None:
        """Ask whether the crop was given in the shape of the photo, and the photo in another."""
        crop_first = pair[0].query is None
        (photo, crop), (of_photo, of_crop) = pair, sizes
        if crop_first:
            photo, crop, of_photo, of_crop = crop, photo, of_crop, of_photo
        own = _shape(photo.size)
        if abs(_shape(crop.size) - own) > _OTHER_SHAPE:
            self._told += 1
            other = abs(_shape(of_photo) - own) > _OTHER_SHAPE
            self._exchanged += other and abs(_shape(of_crop) - own) < _SAME_SHAPE

    def _look_for_padding(
        self, picture: Picture, pixels: Floats, size: tuple[float, float]
    ) -> None:
        """Ask whether pixels lie beyond the part that a picture of its own shape would fill."""
        wider = _shape(size) - _shape(picture.size)
        axis = 0 if wider > 0 else 1
        share = exp(-abs(wider))
        if share > _PADDED_SHARE or not len(pixels):
            return
        side = self._sides.setdefault("crop" if picture.query is None else "photo", _Side())
        side.pictures += 1
        side.matches += len(pixels)
        farthest = pixels[:, axis].max() / picture.size[axis]
        side.beyond = side.beyond or farthest > share + _SLACK_PX / size[axis]

    def check(self, path: Path) -> None:
        """Refuse pictures that look padded or exchanged."""
        if self._exchanged >= max(_LEAST_EXCHANGED, _NEARLY_ALL * self._told):
            raise PredictionError(
                f"the sizes that {counted(self._exchanged, 'file')} state give the crop the shape "
                "of the photo, and the photo another: the two look exchanged",
                where=path,
                expected="the photo as the first picture, the crop as the second, or files named "
                "after both in the order of the fields, such as NAME_dom_NAME.npz",
                fix="exchange the fields of the two pictures, or name the files so",
            )
        for kind, side in self._sides.items():
            if side.pictures >= _LEAST_PADDED and side.matches >= _LEAST_MATCHES:
                self._refuse_padded(kind, side, path)

    def _refuse_padded(self, kind: str, side: _Side, path: Path) -> None:
        if side.beyond:
            return
        raise PredictionError(
            f"the sizes that {counted(side.pictures, 'file')} state have another shape than the "
            f"{kind}, and no match lies right of or below the part that a {kind} of its own shape "
            "would fill: the pictures look padded",
            where=path,
            expected="the sizes of the pictures without padding",
            fix="take width and height before the padding, as in image_size0=[w_new, h_new] of "
            "LoFTR's datasets, or resize without padding",
        )


def _shape(size: tuple[float, float]) -> float:
    return log(size[0] / size[1])
