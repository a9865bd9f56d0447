"""Protocols of galleries of images whose sections do not fit."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

from airzoo_bench.core.errors import ProtocolError
from airzoo_bench.core.validation import validated
from airzoo_bench.protocol.model import shipped_protocols
from airzoo_bench.retrieval.settings import RetrievalProtocol

UNIVERSITY, GTA = "university-1652-drone-to-satellite", "gta-uav-same-area-drone-to-satellite"


def values_of(name: str) -> dict[str, Any]:
    return tomllib.loads(shipped_protocols()[name].read_text(encoding="utf-8"))


NEAR = values_of(GTA)["scores"]["distances"]


@pytest.mark.parametrize(
    ("base", "section", "changes", "named"),
    [
        (UNIVERSITY, "scores", {"distances": NEAR}, "scores.distances"),
        (GTA, "scores", {"distances": None}, "scores.distances"),
        (GTA, "gallery", {"positions": "degrees"}, "positions"),
        (GTA, "scores", {"distances": NEAR | {"sdm_unit": "degree"}}, "sdm_unit"),
        (GTA, "scores", {"ranks_kept": 4}, "ranks_kept"),
        ("uav-visloc-retrieval", "ground_truth", values_of(GTA)["ground_truth"], "ground_truth"),
    ],
)
def test_sections_must_fit(base: str, section: str, changes: dict[str, Any], named: str) -> None:
    values = values_of(base)
    values[section] = {k: v for k, v in (values[section] | changes).items() if v is not None}
    with pytest.raises(ProtocolError, match=named):
        validated(values, RetrievalProtocol, ProtocolError, None, "protocol file")
