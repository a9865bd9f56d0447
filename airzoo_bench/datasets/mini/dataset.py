"""AirZoo-Mini as a dataset: what `prepare airzoo-mini` asks for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from airzoo_bench.core.options import Option
from airzoo_bench.datasets.dataset import Dataset, Prepared, PrepareSettings

__all__ = ["AIRZOO_MINI", "AirZooMini", "MiniOptions"]


@dataclass(frozen=True)
class MiniOptions:
    """Which of the made-up worlds it is."""

    seed: Annotated[
        int, Option("seed", "Another seed is another place, and another benchmark.", least=0)
    ] = 0


class AirZooMini(Dataset[MiniOptions]):
    """The benchmark that is made on the spot."""

    summary = (
        "Make AirZoo-Mini: a made-up world, flights over it, photos, and the truth of every "
        "track.\n\nNeeds no data. Worlds and photos are kept in the data root: a run that was "
        "stopped goes on."
    )
    example = "airzoo-mini"
    options = MiniOptions
    jobs = 2

    def benchmark(self, options: MiniOptions) -> str:
        """Return the name, which has the seed in it where that is not 0."""
        from airzoo_bench.datasets.mini.prepare import mini_protocols

        return mini_protocols(options.seed).every[0].benchmark

    def prepare(self, options: MiniOptions, settings: PrepareSettings) -> Prepared:
        """Make the folder, see `mini.prepare.prepare_airzoo_mini`."""
        from airzoo_bench.datasets.mini.prepare import prepare_airzoo_mini

        return prepare_airzoo_mini(options.seed, settings)


AIRZOO_MINI = AirZooMini()
