"""Many small pictures on one sheet, with a label each, for docs."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, sqrt
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["write_contact_sheet"]

_LABEL_PX = 18
_GAP_PX = 6
_PAPER = (250, 250, 250)
_INK = (20, 20, 20)


def write_contact_sheet(
    images: Sequence[NDArray[np.uint8]],
    labels: Sequence[str],
    path: Path,
    *,
    columns: int | None = None,
    width_px: int = 320,
) -> None:
    """Write pictures in a grid as PNG or JPEG, by the name's ending.

    Parameters
    ----------
    images : sequence of (H, W, 3) uint8 array
        Of any size; each is fitted into its cell, whose shape is that of the first.
    labels : sequence of str
        One an image, shown above it.
    path : Path
    columns : int, optional
        As many as make the grid about square where left out.
    width_px : int
        Of a cell.

    Raises
    ------
    UsageError
        No images, or another number of labels.
    UserError
        The file cannot be written.
    """
    from PIL import Image

    if not images or len(images) != len(labels):
        raise UsageError(
            f"{len(images)} images and {len(labels)} labels",
            where=path,
            expected="one label for each of at least one image",
        )
    across = columns or ceil(sqrt(len(images)))
    height_px = round(width_px * images[0].shape[0] / images[0].shape[1])
    cell = (width_px + _GAP_PX, height_px + _LABEL_PX + _GAP_PX)
    down = ceil(len(images) / across)
    sheet = Image.new("RGB", (cell[0] * across + _GAP_PX, cell[1] * down + _GAP_PX), _PAPER)
    for number, (image, label) in enumerate(zip(images, labels, strict=True)):
        place = (_GAP_PX + cell[0] * (number % across), _GAP_PX + cell[1] * (number // across))
        _put(sheet, Image.fromarray(image), label, place, (width_px, height_px))
    with atomic_write(path) as stream:
        form = "JPEG" if path.suffix.lower() in {".jpg", ".jpeg"} else "PNG"
        sheet.save(stream, format=form, quality=88)


def _put(
    sheet: Image, image: Image, label: str, place: tuple[int, int], size: tuple[int, int]
) -> None:
    from PIL import Image as Images
    from PIL import ImageDraw

    ImageDraw.Draw(sheet).text(place, label, fill=_INK)
    scale = min(size[0] / image.width, size[1] / image.height)
    fitted = (max(round(image.width * scale), 1), max(round(image.height * scale), 1))
    small = image.resize(fitted, Images.Resampling.LANCZOS)
    sheet.paste(small, (place[0], place[1] + _LABEL_PX))
