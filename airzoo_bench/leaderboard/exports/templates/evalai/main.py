"""What EvalAI's worker calls; the host runs it, since EvalAI's own workers have older Pythons."""

from pathlib import Path

from airzoo_bench.leaderboard.exports.evalai_worker import scored


def evaluate(user_submission_file, phase_codename, test_annotation_file=None, **kwargs):
    """Score a submission; `test_annotation_file` is the worker's folder, with the truth."""
    del phase_codename, kwargs
    if test_annotation_file is None:
        raise ValueError("the submissions of this challenge are scored by its host")
    return scored(Path(user_submission_file), Path(test_annotation_file))
