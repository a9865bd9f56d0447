"""A prediction scored in process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from airzoo_bench.evaluation.evaluate import Evaluation, evaluate


def score(path: Path, data: Path, **options: Any) -> Evaluation:
    return evaluate(path, track="retrieval", data=data, **options)
