"""A stated accuracy of the truth: kept in the folder, and said where thresholds are finer."""

from __future__ import annotations

import pytest

from airzoo_bench.evaluation.evaluate import accuracy_notes
from airzoo_bench.protocol.model import load_protocol, shipped_protocols


@pytest.mark.parametrize(
    ("track", "accuracy_m", "fine"),
    [
        ("matching", 0.33, None),
        ("matching", 0.34, "the threshold 1 m of photos-matching measures"),
        ("matching", 4.0, "the thresholds 1, 5, 10 m of photos-matching measure"),
        ("retrieval", 8.3, None),
        ("retrieval", 8.4, "the threshold 25 m of photos-retrieval measures"),
        ("reconstruction", 0.7, "the thresholds 1, 2 m of photos-reconstruction measure"),
        ("matching", None, None),
    ],
)
def test_thresholds_below_three_times_the_accuracy_are_named(
    track: str, accuracy_m: float | None, fine: str | None
) -> None:
    shipped = load_protocol(shipped_protocols()[f"photos-{track}"])
    used = shipped.model_copy(update={"scenes": (shipped.scenes[0],)})
    notes = accuracy_notes(used, {used.scenes[0].id: accuracy_m, "elsewhere": 1e9})
    assert len(notes) == (fine is not None)
    assert all(fine in note and f"good to {accuracy_m:g} m" in note for note in notes)
