"""AirZoo-Mini as a dataset: the options of `prepare airzoo-mini`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import read_text
from airzoo_bench.core.registry import Option
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.mini.noise import keyed
from airzoo_bench.datasets.mini.prepare import mini_protocols, prepare_airzoo_mini
from airzoo_bench.datasets.settings import Prepared, PrepareSettings


@dataclass(frozen=True)
class MiniOptions:
    """Which of the made-up worlds it is."""

    seed: Annotated[
        int, Option("seed", "Another seed is another place, and another benchmark.", least=0)
    ] = 0
    key_file: Annotated[
        Path | None,
        Option(
            "key-file",
            "Make a sealed edition: a file with 32 hexadecimal digits that nobody else knows, "
            "such as `openssl rand -hex 16` prints. docs/leaderboard.md says how to host it.",
        ),
    ] = None

    @property
    def source(self) -> int:
        """The source of all randomness: the seed, or the key."""
        if self.seed >> 64:
            raise UsageError("the seed is too large", where="--seed", expected="less than 2**64")
        if self.key_file is None:
            return self.seed
        if self.seed:
            raise UsageError("--seed and --key-file are both given", fix="leave one of them out")
        text = read_text(self.key_file, UsageError, "key file", 1 << 10).strip()
        if not re.fullmatch("[0-9a-fA-F]{32}", text):
            fix = f"openssl rand -hex 16 > {self.key_file}"
            expected = "32 hexadecimal digits"
            raise UsageError("holds no key", where=self.key_file, expected=expected, fix=fix)
        return keyed(bytes.fromhex(text))


class AirZooMini(Dataset[MiniOptions]):
    """The benchmark that is made on the spot."""

    name = "airzoo-mini"
    about = about_of("airzoo-mini")
    options = MiniOptions
    jobs = 2

    def benchmark(self, options: MiniOptions) -> str:
        """Return the name, which has the seed in it where that is not 0."""
        return mini_protocols(options.source).benchmark

    def folder_name(self, options: MiniOptions, root: Path) -> str:
        """Return the benchmark's name."""
        return self.benchmark(options)

    def is_prepared(self, options: MiniOptions, settings: PrepareSettings) -> bool:
        """Return False: worlds and photos that are kept make another run short."""
        return False

    def prepare(self, options: MiniOptions, settings: PrepareSettings) -> Prepared:
        """Make the folder, see `mini.prepare.prepare_airzoo_mini`."""
        return prepare_airzoo_mini(options.source, settings)


AIRZOO_MINI = AirZooMini()
