"""The cameras and poses that UAVScenes states of a run, in one JSON file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import validation_message
from airzoo_bench.datasets.published.reconstructions import stem_of
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses

__all__ = ["Sample", "read_samples", "sample_cameras", "sample_poses"]

_LIMIT_BYTES = 128 << 20
_MOST_POSES = 200_000

Number = Annotated[float, Field(allow_inf_nan=False)]
Row4 = tuple[Number, Number, Number, Number]
Row3 = tuple[Number, Number, Number]


class Sample(BaseModel):
    """An image's entry; keys beyond these are passed over."""

    model_config = ConfigDict(frozen=True)

    name: str = Field(alias="OriginalImageName", max_length=200)
    to_world: tuple[Row4, Row4, Row4, Row4] = Field(alias="T4x4")
    matrix: tuple[Row3, Row3, Row3] = Field(alias="P3x3")
    width: Number | None = Field(default=None, alias="Width")
    height: Number | None = Field(default=None, alias="Height")
    k1: Number = Field(default=0.0, alias="K1")
    k2: Number = Field(default=0.0, alias="K2")
    p1: Number = Field(default=0.0, alias="P1")
    p2: Number = Field(default=0.0, alias="P2")
    k3: Number = Field(default=0.0, alias="K3")

    @property
    def distortion(self) -> tuple[float, ...]:
        """OpenCV's k1 k2 p1 p2 k3."""
        return self.k1, self.k2, self.p1, self.p2, self.k3


_SAMPLES = TypeAdapter(Annotated[list[Sample], Field(min_length=1, max_length=_MOST_POSES)])


def read_samples(path: Path) -> dict[str, Sample]:
    """Read a run's poses, by time stamp with a point."""
    text = read_text(path, BenchmarkError, "file of poses", _LIMIT_BYTES)
    try:
        samples = _SAMPLES.validate_json(text.removeprefix("\ufeff"))
    except ValidationError as error:
        raise BenchmarkError(
            validation_message(error, Sample),
            where=path,
            expected="a list of OriginalImageName, T4x4 and P3x3, as UAVScenes has it",
            fix="download the file again",
        ) from error
    found: dict[str, Sample] = {}
    for sample in samples:
        other = found.setdefault(stem_of(sample.name), sample)
        same = (other.to_world, other.matrix) == (sample.to_world, sample.matrix)
        if not same:
            raise BenchmarkError(
                f"has two poses of {sample.name!r}", where=path, fix="download the file again"
            )
    return found


def sample_poses(samples: Sequence[Sample], path: Path) -> Poses:
    """Return the poses of images, world-to-camera."""
    matrices = np.array([sample.to_world for sample in samples])
    names = [sample.name for sample in samples]
    last = (0.0, 0.0, 0.0, 1.0)
    odd = np.asarray((np.abs(matrices[:, 3] - last) > 1e-6).any(axis=1))
    if odd.any():
        turned = (np.abs(matrices[odd][:, :, 3] - last) < 1e-6).all()
        raise CameraError(
            f"T4x4 whose last row is not 0 0 0 1: "
            f"{first_of([name for name, bad in zip(names, odd, strict=True) if bad], len(names))}",
            where=path,
            expected="camera-to-world matrices, rows first",
            fix="transpose them: columns stand first" if turned else "download the file again",
        )
    rotations: Floats = np.swapaxes(matrices[:, :3, :3], 1, 2)
    try:
        return Poses.from_centres(rotations, matrices[:, :3, 3], names)
    except CameraError as error:
        raise error.inside(path) from error


def sample_cameras(
    samples: Sequence[Sample], sizes: Sequence[tuple[int, int]], lens: str, path: Path
) -> Cameras:
    """Return the cameras of images, whose lens is that of the file or "none"."""
    names = [sample.name for sample in samples]
    stated = [(sample.width, sample.height) for sample in samples]
    other = [
        f"{name} is {size[0]}x{size[1]} px, not {given[0]:g}x{given[1]:g}"
        for name, size, given in zip(names, sizes, stated, strict=True)
        if given[0] and given[1] and size != given
    ]
    if other:
        raise CameraError(
            f"photos of another size than stated: {first_of(other, len(names))}",
            where=path,
            fix="use the photos as they were downloaded",
        )
    width, height = np.array(sizes).T
    matrices = np.array([sample.matrix for sample in samples])
    bent = np.array([sample.distortion for sample in samples]) * (lens == "file")
    try:
        return Cameras.from_matrices(matrices, width, height, bent, names=names)
    except CameraError as error:
        raise error.inside(path) from error
