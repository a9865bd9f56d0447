"""What runs were measured with, and what the board measures with now."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.evaluation.evaluate import truth_fingerprint
from airzoo_bench.evaluation.opening import read_truths
from airzoo_bench.leaderboard.answer import SealedAnswer
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.results.result import read_result

__all__ = ["Measure", "Measures", "measure_of"]


@dataclass(frozen=True)
class Measure:
    """What scores depend on beside the predictions."""

    protocol: str
    version: int
    fingerprint: str
    truth: str

    def outdated(self, now: Measure) -> str:
        """Say what has been replaced since; nothing where scores are comparable."""
        if self.version != now.version:
            return f"protocol v{self.version}, now v{now.version}"
        if self.fingerprint != now.fingerprint:
            return "other settings of the protocol"
        return "" if self.truth == now.truth else "another truth"


def measure_of(run: Path) -> Measure:
    """Read what a run was measured with."""
    sealed = run / "answer.json"
    if sealed.is_file():
        answer = SealedAnswer.model_validate_json(sealed.read_bytes())
        truth = answer.truth_commitment
        return Measure(answer.protocol, answer.protocol_version, answer.protocol_fingerprint, truth)
    result = read_result(run / "result.json")
    used = result.protocol
    return Measure(used.name, used.version, used.fingerprint, result.truth.fingerprint)


@dataclass
class Measures:
    """What is measured with now, by protocol; each truth is read once.

    Attributes
    ----------
    data : Path
        The data root.
    """

    data: Path
    _known: dict[tuple[str, bool], Measure] = field(default_factory=dict)

    def of(self, protocol: str, *, sealed: bool) -> Measure:
        """Read a protocol and the fingerprint of its truth."""
        if (protocol, sealed) not in self._known:
            self._known[protocol, sealed] = self._read(protocol, sealed=sealed)
        return self._known[protocol, sealed]

    def _read(self, name: str, *, sealed: bool) -> Measure:
        protocol = find_protocol(name, self.data)
        if sealed:
            public = find_benchmark(protocol.benchmark, self.data, sealed=True).file.sealed
            truth = "" if public is None else public.commitment
        else:
            _, truths = read_truths(protocol, self.data)
            truth = truth_fingerprint(truths)
        return Measure(protocol.name, protocol.version, protocol.fingerprint, truth)
