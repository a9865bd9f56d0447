"""Protocols of galleries of images: sections that do not fit, and how keys are named."""

from __future__ import annotations

import tomllib

import pytest

from airzoo_bench.core.errors import ProtocolError
from airzoo_bench.core.validation import validated
from airzoo_bench.protocol.model import shipped_protocols
from airzoo_bench.retrieval.settings import RetrievalProtocol


def refused(base: str, section: str, **changes: object) -> str:
    """Return what is said of a shipped protocol with other values in a section."""
    path = shipped_protocols()[base]
    values = tomllib.loads(path.read_text(encoding="utf-8"))
    values[section] = {k: v for k, v in (values[section] | changes).items() if v is not None}
    with pytest.raises(ProtocolError) as error:
        validated(values, RetrievalProtocol, ProtocolError, path, "protocol file")
    return str(error.value)


def test_sections_of_a_protocol_must_fit() -> None:
    university, gta = "university-1652-drone-to-satellite", "gta-uav-same-area-drone-to-satellite"
    near = tomllib.loads(shipped_protocols()[gta].read_text(encoding="utf-8"))["scores"][
        "distances"
    ]
    assert "positions of the gallery's images" in refused(university, "scores", distances=near)
    assert "positions of the gallery's images" in refused(gta, "scores", distances=None)
    assert "'plane' is for positions in metres" in refused(gta, "gallery", positions="degrees")
    degree = near | {"sdm_unit": "degree"}
    assert "sdm_unit = 'degree' needs" in refused(gta, "scores", distances=degree)
    assert "pairs is given with rule = 'pairs'" in refused(
        university, "ground_truth", pairs="positive"
    )
    assert "ranks_kept must reach" in refused(gta, "scores", ranks_kept=4)
    said = refused("uav-visloc-retrieval", "ground_truth", rule="labels", iou_above=None)
    assert "key 'ground_truth.rule' is 'labels': Input should be 'plane', 'dsm' or 'iou'" in said
