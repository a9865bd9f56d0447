"""Protocol files: where they are found, and what the fingerprint sees.

What is refused is in tests/goldens/refusals.txt.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from airzoo_bench.core.errors import ProtocolError
from airzoo_bench.protocol.model import (
    find_protocol,
    load_protocol,
    protocol_files,
    protocol_for,
    shipped_protocols,
)


def written(path: Path, edit: Callable[[dict[str, Any]], object]) -> Path:
    values = tomllib.loads(shipped_protocols()["photos-retrieval"].read_text())
    edit(values)
    path.write_text(tomli_w.dumps(values))
    return path


def under(*keys: str, **changes: Any) -> Callable[[dict[str, Any]], None]:
    def edit(values: dict[str, Any]) -> None:
        for key in keys:
            values = values[key]
        values.update(changes)

    return edit


def test_protocols_of_prepared_folders_are_found_but_never_shadow(tmp_path: Path) -> None:
    for name in ("mine", "photos-retrieval"):
        path = tmp_path / "park" / "protocols" / f"{name}.toml"
        path.parent.mkdir(parents=True, exist_ok=True)
        written(path, under(name=name, title="Changed"))
    assert find_protocol("mine", tmp_path).title == "Changed"
    assert find_protocol("mine", tmp_path / "park").title == "Changed"
    assert find_protocol("photos-retrieval", tmp_path).title != "Changed"
    assert set(protocol_files(tmp_path / "none")) == set(shipped_protocols())


def test_the_fingerprint_sees_what_changes_scores_and_nothing_else(tmp_path: Path) -> None:
    plain = load_protocol(written(tmp_path / "a.toml", under()))

    def changed(edit: Callable[[dict[str, Any]], object]) -> bool:
        other = load_protocol(written(tmp_path / "b.toml", edit))
        return other.fingerprint != plain.fingerprint

    assert not changed(under(title="T", summary="S"))
    assert not changed(lambda v: v["scenes"][0].update(title="T", queries=7))
    for edit in (
        under(version=3),
        under(name="other"),
        lambda v: v["scenes"][0].update(id="other"),
        under("gallery", overlap=0.25),
        under("gallery", tile_sizes_px=[512, 1024]),
        under("gallery", least_valid_share="none"),
        under("ground_truth", rule="dsm"),
        under("ground_truth", box_growth=0.2),
        under("ground_truth", without_positive="miss"),
        under("scores", ap="min"),
        under("scores", sdm_scale_per_m=0.002),
    ):
        assert changed(edit)


def truth(**values: object) -> dict[str, dict[str, object]]:
    return {"ground_truth": values}


def test_a_protocol_for_own_data() -> None:
    photos = load_protocol(shipped_protocols()["photos-retrieval"])
    mine = protocol_for(photos, "park", {"gallery": {"tile_sizes_px": (256, 128)}})
    assert (mine.name, mine.benchmark) == ("park-retrieval", "park")
    assert mine.version == photos.version
    assert [scene.id for scene in mine.scenes] == ["park"]
    assert mine.gallery.tile_sizes_px == (256, 128)
    assert mine.scores == photos.scores
    assert mine.ground_truth == photos.ground_truth
    iou = protocol_for(photos, "park", truth(rule="iou", iou_above=0.39))
    assert (iou.ground_truth.rule, iou.ground_truth.iou_above) == ("iou", 0.39)
    # A base that has the rule already takes a threshold alone.
    assert protocol_for(iou, "lake", truth(iou_above=0.14)).ground_truth.iou_above == 0.14
    assert protocol_for(iou, "lake", {}).ground_truth.iou_above == 0.39
    with pytest.raises(ProtocolError, match="iou_above is given with rule = 'iou', and only then"):
        protocol_for(photos, "park", truth(iou_above=0.3))
    with pytest.raises(ProtocolError, match="would make a second protocol photos-retrieval"):
        protocol_for(photos, "photos", {})
