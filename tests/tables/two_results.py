"""Two results of the paper's real benchmark, and the table of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.results.result import ProtocolUsed, Result, TruthUsed
from tests.results.made import result

Show = Callable[..., list[dict[str, str]]]
CITY, RURAL = {"recall@1": 0.5}, {"recall@1": 0.25}


def made(
    method: str, scenes: dict[str, dict[str, float]], *, shipped: bool = True, **parts: Any
) -> Result:
    """Return a result of the paper's real benchmark, by the shipped protocol or another."""
    base = result(method)
    protocol = load_protocol(shipped_protocols()["airzoo-real-retrieval"])
    values = {name: base.overall | scores for name, scores in scenes.items()}
    mean = {key: sum(v[key] for v in values.values()) / len(values) for key in base.overall}
    titles = {scene.id: scene.title for scene in protocol.scenes}
    numbers = {"City": 161, "Rural": 190}
    pooled = {
        key: sum(n * values[name][key] for name, n in numbers.items()) / sum(numbers.values())
        for key in base.overall
    }
    content = base.model_dump(by_alias=True) | {
        "protocol": ProtocolUsed(
            name=protocol.name,
            version=1,
            fingerprint=protocol.fingerprint if shipped else "other",
            settings={},
        ),
        "truth": TruthUsed(
            benchmark="airzoo-real", version=1, fingerprint="t", scene_titles=titles
        ),
        "scenes": values,
        "counts": {name: {"queries": n} for name, n in numbers.items()},
        "overall": mean,
        "pooled": pooled,
    }
    return Result.model_validate(content | parts).with_checksum()
