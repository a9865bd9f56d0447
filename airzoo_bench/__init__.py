"""Evaluation suite for aerial 3D vision: retrieval, cross-view matching, reconstruction.

What stands here is imported when it is first asked for: ``import airzoo_bench`` is cheap.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from airzoo_bench.core.version import __version__

if TYPE_CHECKING:
    from airzoo_bench.api.alignment import CameraAlignment, align_cameras
    from airzoo_bench.api.benchmark import BlindBenchmark, load_benchmark
    from airzoo_bench.api.clouds import CloudComparison, cloud_scores
    from airzoo_bench.api.comparison import Comparison, compare
    from airzoo_bench.api.evaluation import Check, check, evaluate
    from airzoo_bench.api.hits import average_precision, recall_at_k
    from airzoo_bench.api.intervals import ConfidenceInterval, bootstrap_ci
    from airzoo_bench.api.poses import pose_errors, pose_scores
    from airzoo_bench.api.prediction_writer import PredictionWriter
    from airzoo_bench.api.results import Result, load_result
    from airzoo_bench.api.retrieval import descriptor_scores, retrieval_scores, similarity_scores
    from airzoo_bench.api.scores import QueryScores
    from airzoo_bench.api.solving import solve_pose
    from airzoo_bench.core.errors import ArgumentError, UserError
    from airzoo_bench.matching.metrics import PoseErrors
    from airzoo_bench.matching.solving import PoseEstimate

__all__ = [
    "ArgumentError",
    "BlindBenchmark",
    "CameraAlignment",
    "Check",
    "CloudComparison",
    "Comparison",
    "ConfidenceInterval",
    "PoseErrors",
    "PoseEstimate",
    "PredictionWriter",
    "QueryScores",
    "Result",
    "UserError",
    "__version__",
    "align_cameras",
    "average_precision",
    "bootstrap_ci",
    "check",
    "cloud_scores",
    "compare",
    "descriptor_scores",
    "evaluate",
    "load_benchmark",
    "load_result",
    "pose_errors",
    "pose_scores",
    "recall_at_k",
    "retrieval_scores",
    "similarity_scores",
    "solve_pose",
]

# Which module has which names; the imports above say the same to editors and type checkers.
_HOMES = {
    "api.alignment": ("CameraAlignment", "align_cameras"),
    "api.benchmark": ("BlindBenchmark", "load_benchmark"),
    "api.clouds": ("CloudComparison", "cloud_scores"),
    "api.comparison": ("Comparison", "compare"),
    "api.evaluation": ("Check", "check", "evaluate"),
    "api.hits": ("average_precision", "recall_at_k"),
    "api.intervals": ("ConfidenceInterval", "bootstrap_ci"),
    "api.poses": ("pose_errors", "pose_scores"),
    "api.prediction_writer": ("PredictionWriter",),
    "api.results": ("Result", "load_result"),
    "api.retrieval": ("descriptor_scores", "retrieval_scores", "similarity_scores"),
    "api.scores": ("QueryScores",),
    "api.solving": ("solve_pose",),
    "core.errors": ("ArgumentError", "UserError"),
    "matching.solving": ("PoseEstimate",),
    "matching.metrics": ("PoseErrors",),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

# Type checkers know the names above; of a module with `__getattr__` they would accept any.
if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """Import a name from its home, once."""
        if name not in _HOME_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_HOME_OF[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
