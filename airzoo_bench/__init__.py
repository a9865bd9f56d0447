"""Evaluation suite for aerial 3D vision: retrieval, cross-view matching, reconstruction.

Each name is imported when it is first asked for: ``import airzoo_bench`` is cheap.
"""

from importlib import import_module
from typing import TYPE_CHECKING

_HOMES = {
    "api.benchmark": "BlindBenchmark load_benchmark",
    "api.geometry": "align_cameras cloud_scores pose_errors pose_scores solve_pose",
    "api.results": "Comparison Result bootstrap_ci check compare evaluate load_result",
    "api.retrieval": "average_precision chance_level recall_at_k retrieval_scores",
    "api.arguments": "Scores",
    "api.writer": "PredictionWriter",
    "core.errors": "ArgumentError UserError",
    "core.version": "__version__",
    "evaluation.evaluate": "Check",
    "matching.metrics": "PoseErrors",
    "matching.solving": "PoseEstimate",
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names.split()}

__all__ = [
    "ArgumentError",
    "BlindBenchmark",
    "Check",
    "Comparison",
    "PoseErrors",
    "PoseEstimate",
    "PredictionWriter",
    "Result",
    "Scores",
    "UserError",
    "__version__",
    "align_cameras",
    "average_precision",
    "bootstrap_ci",
    "chance_level",
    "check",
    "cloud_scores",
    "compare",
    "evaluate",
    "load_benchmark",
    "load_result",
    "pose_errors",
    "pose_scores",
    "recall_at_k",
    "retrieval_scores",
    "solve_pose",
]

if TYPE_CHECKING:
    from airzoo_bench.api.arguments import Scores
    from airzoo_bench.api.benchmark import BlindBenchmark, load_benchmark
    from airzoo_bench.api.geometry import (
        align_cameras,
        cloud_scores,
        pose_errors,
        pose_scores,
        solve_pose,
    )
    from airzoo_bench.api.results import (
        Comparison,
        Result,
        bootstrap_ci,
        check,
        compare,
        evaluate,
        load_result,
    )
    from airzoo_bench.api.retrieval import (
        average_precision,
        chance_level,
        recall_at_k,
        retrieval_scores,
    )
    from airzoo_bench.api.writer import PredictionWriter
    from airzoo_bench.core.errors import ArgumentError, UserError
    from airzoo_bench.core.version import __version__
    from airzoo_bench.evaluation.evaluate import Check
    from airzoo_bench.matching.metrics import PoseErrors
    from airzoo_bench.matching.solving import PoseEstimate
else:

    def __getattr__(name: str) -> object:
        if name not in _HOME_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        home = import_module(f"{__name__}.{_HOME_OF[name]}")
        return globals().setdefault(name, getattr(home, name))


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
