"""What all own surveys have in common."""

from __future__ import annotations

import re
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, TypeVar

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.native import NativeDataset
from airzoo_bench.datasets.surveys.options import SurveyOptions

if TYPE_CHECKING:
    from airzoo_bench.datasets.truths import BenchmarkProtocols

__all__ = ["WITHOUT_TRUTH", "Survey", "given"]

WITHOUT_TRUTH = MappingProxyType(
    {
        "matching": "no photo has GPS position and gimbal angles (--priors)",
        "reconstruction": "no true cloud was given (--cloud)",
    }
)
"""Why a track may have no truth in a survey."""

_LONGEST_NAME = 48  # of which more names are made


OptionsT = TypeVar("OptionsT", bound=SurveyOptions)


class Survey(NativeDataset[OptionsT]):
    """One scene of own photos, whose protocols start from those of `prepare photos`.

    Attributes
    ----------
    needs : tuple of str
        Options that must be given, by their fields.
    needs_ground : bool
        Whether a surface model or a plane must be given as well.
    """

    needs: ClassVar[tuple[str, ...]] = ()
    needs_ground: ClassVar[bool] = False
    is_published = False

    def benchmark(self, options: OptionsT) -> str:
        """Return the name that was given, or the source's."""
        from airzoo_bench.core.validation import SAFE_NAME

        name = options.name or options.source.resolve().stem
        if not re.fullmatch(SAFE_NAME, name) or len(name) > _LONGEST_NAME:
            raise UsageError(
                f"{name[:80]!r} cannot be the name of a benchmark",
                where="--name" if options.name else options.source,
                expected="letters, digits, '.', '_' and '-', beginning with a letter or digit, at "
                f"most {_LONGEST_NAME} characters",
                fix="name it with --name",
            )
        return name

    def scenes(self, options: OptionsT) -> list[str]:
        """Return the one scene, called like the benchmark, if all that it needs was given."""
        for field in self.needs:
            given(getattr(options, field), field)
        if self.needs_ground and options.dsm is None and options.plane_height is None:
            raise UsageError("--dsm or --plane-height must be given", where=options.source)
        return [self.benchmark(options)]

    def protocols(self, options: OptionsT, root: Path) -> BenchmarkProtocols:
        """Return the protocols of own photos, as changed by the options."""
        from airzoo_bench.datasets.photos_dataset import photo_protocols

        return photo_protocols(options, self.benchmark(options), root, self.map_of(options))

    def map_of(self, options: OptionsT) -> Path | None:
        """Return the map that tiles are cut from, as far as it can be found."""
        return options.dom

    def prepare(self, options: OptionsT, settings: PrepareSettings) -> Prepared:
        """Make the folder, and say which sides tiles have that were asked for in metres."""
        from airzoo_bench.datasets.photos_dataset import say_tile_sizes

        say_tile_sizes(options, self.map_of(options), settings.note)
        return super().prepare(options, settings)


def given(path: Path | None, field: str) -> Path:
    """Return a path that the user must give."""
    if path is None:
        raise UsageError(f"--{field} must be given")
    return path
